// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

/// Images that are computed row by row, from top to bottom, when a row is asked for. Only a few
/// rows are in memory at a time, so what one step hands to the next stays in the cache.
///
/// Rows are numbered 0..height-1.

namespace all_in_focus::core {

/// Writes each of n values three times: one for each channel of a pixel.
void threeTimes(const std::int16_t* values, int n, std::int16_t* out);

/// Units of a gray level in a downsampled image.
constexpr int kGrayUnit = 256;

/// The next level of a Gaussian pyramid. image: CV_8UC1 gray levels, or CV_16UC1 in units of 1 / kGrayUnit;
/// level: another image, CV_16UC1 in these units. Gray levels are taken a few rows at a time, so that no
/// 16-bit copy of a whole frame is made.
void downsample(const cv::Mat& image, cv::Mat& level);

/// Holds the last rows of an image: row y lies in line y modulo the number of lines.
template <typename Value>
class LineBuffer {
 public:
  /// Forgets all rows. Keeps the memory.
  void begin(int lines, int width) {
    width_ = static_cast<size_t>(width);
    pixels_.resize(lines * width_);
    y_of_line_.assign(lines, -1);
  }

  /// Returns row y. If it is not in the buffer, calls compute(y, out), which writes `width` values to out.
  /// The pointer is valid until another row takes the line.
  template <typename Compute>
  const Value* row(int y, const Compute& compute) {
    const size_t line = static_cast<size_t>(y) % y_of_line_.size();
    Value* out = &pixels_[line * width_];
    if (y_of_line_[line] != y) compute(y, out);
    y_of_line_[line] = y;
    return out;
  }

 private:
  size_t width_ = 0;
  std::vector<Value> pixels_;
  std::vector<int> y_of_line_;  ///< -1: empty
};

/// The image convolved with a Gaussian of 11 x 11 pixels, or of 7 x 7 where the weights beyond are less than
/// 1e-4 of the greatest (sigma < 0.93 px). Borders as BORDER_REFLECT_101.
class GaussianRows {
 public:
  static constexpr int kMostRadius = 5;
  using Window = std::array<float, kMostRadius + 1>;           ///< weights from the middle outwards
  using Taps = std::array<const float*, 2 * kMostRadius + 1>;  ///< of these the first 2 radius_ + 1

  /// sigma: pixels.
  void begin(const cv::Size& size, double sigma);

  /// Writes row y to out. source(v, out) writes row v of the input to out.
  template <typename Source>
  void row(int y, const Source& source, float* out) {
    Taps rows;
    for (int k = -radius_; k <= radius_; ++k) {
      const int mirrored = cv::borderInterpolate(y + k, size_.height, cv::BORDER_REFLECT_101);
      rows[k + radius_] = horizontal_.row(mirrored, [&](int v, float* convolved) {
        source(v, padded_.data() + radius_);
        convolvePadded(convolved);
      });
    }
    convolve(rows, out);
  }

 private:
  void convolvePadded(float* out);
  void convolve(const Taps& taps, float* out) const;

  cv::Size size_;
  int radius_ = 0;  ///< 3 or 5
  Window window_;
  LineBuffer<float> horizontal_;  ///< input rows, convolved horizontally
  std::vector<float> padded_;     ///< an input row with radius_ pixels more on both sides
};

/// The image upsampled by linear interpolation, as cv::resize does with INTER_LINEAR.
class UpsampledRows {
 public:
  /// Keeps its tables if the sizes are the same as before.
  void begin(const cv::Size& input, const cv::Size& output);

  /// Returns row y of the output, valid until the next call. image: CV_32FC1, the input.
  const float* row(int y, const cv::Mat& image);

 private:
  /// Output coordinate i is input coordinate first[i] times 1 - fraction[i] plus second[i] times fraction[i].
  struct Axis {
    std::vector<int> first, second;
    std::vector<float> fraction;
    void begin(int input, int output);
  };

  cv::Size input_, output_;
  Axis x_, y_;
  LineBuffer<float> horizontal_;  ///< input rows, upsampled horizontally
  std::vector<float> out_;        ///< a row of the output
};

}  // namespace all_in_focus::core
