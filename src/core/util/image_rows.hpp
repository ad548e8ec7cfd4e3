// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <opencv2/core.hpp>
#include <vector>

// Images that are never made as a whole: their rows are computed when they are asked for, top down, and a few
// are kept for the rows that follow. So what a step hands to the next one stays in the cache.

namespace all_in_focus::core {

/// The last rows of an image of floats.
class KeptRows {
 public:
  /// Forgets all rows. The buffer is reused.
  void begin(int kept, int width);

  /// Row y, valid until as many other rows have been asked for as are kept. compute(y, out) is called if it
  /// is not there.
  template <typename Compute>
  const float* row(int y, const Compute& compute) {
    const size_t place = static_cast<size_t>(y) % kept_y_.size();
    float* out = &rows_[place * width_];
    if (kept_y_[place] != y) compute(y, out);
    kept_y_[place] = y;
    return out;
  }

 private:
  size_t width_ = 0;
  std::vector<float> rows_;
  std::vector<int> kept_y_;
};

/// Coordinates begin..end-1 of a resampled row; the pixels that u is made of begin at u + offset. In a run of
/// many they are neighbours in memory, as vectors like them.
struct TapRun {
  int begin, end, offset;
};

/// Adds the next coordinate u, made of the pixels `first` and following.
void appendToRuns(std::vector<TapRun>& runs, int u, int first);

/// A Gaussian window of 11 rows and columns: that of cv::GaussianBlur for a sigma of 1.2 or 1.25 px.
class GaussianRows {
 public:
  static constexpr int kRadius = 5;
  using Window = std::array<float, kRadius + 1>;  ///< from the middle outwards

  void begin(const cv::Size& size, double sigma);

  /// Row y of the smoothed image; source(y, out) computes one of the image itself.
  template <typename Source>
  void row(int y, const Source& source, float* out) {
    std::array<const float*, 2 * kRadius + 1> rows;
    for (int k = -kRadius; k <= kRadius; ++k) {
      const int mirrored = cv::borderInterpolate(y + k, size_.height, cv::BORDER_REFLECT_101);
      rows[k + kRadius] = along_.row(mirrored, [&](int v, float* smoothed) {
        source(v, padded_.data() + kRadius);
        smoothAlong(smoothed);
      });
    }
    smoothAcross(rows, out);
  }

 private:
  void smoothAlong(float* out);
  void smoothAcross(const std::array<const float*, 2 * kRadius + 1>& rows, float* out) const;

  cv::Size size_;
  Window window_;
  KeptRows along_;             ///< rows that have been smoothed along x
  std::vector<float> padded_;  ///< a row with its mirror images on both sides
};

/// An image scaled down, by the mean over areas, as cv::resize does with INTER_AREA.
class ReducedRows {
 public:
  void begin(const cv::Size& large, const cv::Size& small);

  /// Row y of the small image; source(y) returns a row of the large one.
  template <typename Source>
  void row(int y, const Source& source, float* out) {
    std::fill(sum_.begin(), sum_.end(), 0.0f);
    for (int k = 0; k < y_.taps; ++k) {
      const float share = y_.share[y_.taps * y + k];
      if (share > 0) addRow(source(y_.first[y] + k), share);
    }
    sumAlong(out);
  }

 private:
  struct Axis {  ///< by small coordinate: shares of the large ones from `first` on
    int taps = 0;
    std::vector<int> first;
    std::vector<float> share;
    void begin(int large, int small);
  };
  void addRow(const float* row, float share);
  void sumAlong(float* out) const;

  cv::Size large_, small_;
  Axis x_, y_;
  std::vector<float> sum_;
};

/// An image scaled up, as cv::resize does with INTER_LINEAR.
class EnlargedRows {
 public:
  void begin(const cv::Size& small, const cv::Size& large);

  /// Row y of the large image; source(y, out) computes one of the small one. Valid until the next call.
  template <typename Source>
  const float* row(int y, const Source& source) {
    const auto widened = [&](int v) {
      return widened_.row(v, [&](int, float* out) {
        source(v, row_.data());
        widen(out);
      });
    };
    const float* north = widened(y_.first[y]);
    const float* south = widened(y_.second[y]);
    return blend(north, south, y_.fraction[y]);
  }

 private:
  struct Axis {  ///< by large coordinate: (1 - fraction) small[first] + fraction small[second]
    std::vector<int> first, second;
    std::vector<float> fraction;
    void begin(int small, int large);
  };
  void widen(float* out) const;
  const float* blend(const float* north, const float* south, float fraction);

  cv::Size small_, large_;
  Axis x_, y_;
  KeptRows widened_;              ///< small rows, scaled along x
  std::vector<float> row_, out_;  ///< a small one, a large one
};

}  // namespace all_in_focus::core
