// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "alignment/similarity_transform.hpp"

namespace all_in_focus::core {

/// Holds the last rows of an image that is computed row by row, from top to bottom: row y lies in line y
/// modulo the number of lines. Rows are numbered 0..height-1.
template <typename Value>
class LineBuffer {
 public:
  /// Forgets all rows. Keeps the memory.
  void begin(int lines, int width) {
    width_ = static_cast<std::size_t>(width);
    pixels_.resize(lines * width_);
    y_of_line_.assign(lines, -1);
  }

  /// Returns row y. If it is not in the buffer, calls compute(y, out), which writes `width` values to out.
  /// The pointer is valid until another row takes the line.
  template <typename Compute>
  const Value* row(int y, const Compute& compute) {
    const std::size_t line = static_cast<std::size_t>(y) % y_of_line_.size();
    Value* out = &pixels_[line * width_];
    if (y_of_line_[line] != y) compute(y, out);
    y_of_line_[line] = y;
    return out;
  }

 private:
  std::size_t width_ = 0;
  std::vector<Value> pixels_;
  std::vector<int> y_of_line_;  ///< -1: empty
};

/// Brings frames into the geometry of the reference: out(p) = frame(p') by a Lanczos kernel of six taps,
/// along the rows first and then across them. What a frame does not show is continued from its border.
///
/// A roll is two shears: along row v of the frame, x of the output is read at
///   u = cx + (scale / cos) (x - cx) - tan (v - cy - dy) + dx,
/// and across these rows, y is read at
///   v = cy + scale (sin (x - cx) + cos (y - cy)) + dy.
/// Without a roll u is the same in all rows and v in all columns (Catmull and Smith 1980).
///
/// Computes in 16-bit integers, which is right to a few hundredths of a gray level before the last rounding.
/// A frame of 640x480 takes 0.45 ms, 4.0 if it rolls; cv::warpAffine takes 6.6 ms with its cubic kernel and
/// 23 with Lanczos' (one thread), and rounds positions to a 32nd of a pixel.
/// Frames of 16 bits are warped by OpenCV's Lanczos kernel of eight taps.
class ReferenceWarp {
 public:
  /// frame: CV_8UC3 or CV_16UC3, else std::invalid_argument; not shared with out. transform: from the
  /// reference to the frame; its angle less than a radian, or the picture is too coarse.
  void compute(const cv::Mat& frame, const SimilarityTransform& transform, const cv::Point2d& center,
               cv::Mat& out);

 private:
  /// Six taps at each of a row of positions that are equally far apart.
  struct Taps {
    std::vector<int> first;             ///< pixel of the first tap
    std::vector<std::int16_t> single;   ///< by tap, position; times 2^15
    std::vector<std::int16_t> weights;  ///< by tap, position, channel
    std::vector<int> ends;  ///< of runs of positions whose first taps lie side by side: one loop each

    /// Positions begin, begin + step, ..., where pixels 0..length-1 are. channels: 1 or 3.
    void prepare(double begin, double step, int count, int length, int channels);
  };
  struct Strip {
    LineBuffer<std::int16_t> along;    ///< rows of the frame that have been warped along x; gray levels * 2^6
    std::vector<std::int16_t> padded;  ///< a row of the frame and its borders; gray levels * 2^7
    Taps sheared, across;              ///< of a transform that rolls: of a row of the frame; of the output
  };

  void computeStrip(const cv::Mat& frame, const SimilarityTransform& transform, const cv::Point2d& center,
                    const cv::Range& rows, Strip& strip, cv::Mat& out) const;

  Taps columns_, rows_;  ///< of a transform that does not roll
  std::vector<Strip> strips_;
};

}  // namespace all_in_focus::core
