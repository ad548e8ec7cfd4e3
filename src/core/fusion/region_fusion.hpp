// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/fusion.hpp"

namespace all_in_focus::core {

/// Sums over the gray pixels of one region in one frame.
struct GraySums {
  std::uint64_t n = 0;
  std::uint64_t sum = 0;
  std::uint64_t sum_of_squares = 0;
};

/// Focus measure of a region: NV = 1 / (n mu) * sum (I - mu)^2, mu the mean gray value. 0 for an empty or
/// black one.
double normalizedVariance(const GraySums& sums);

/// The paper's fusion (section 2.3): in every region the frame with the greatest normalised variance wins,
/// its pixels are copied. The first of equal frames wins. Label 0, if there, is one region more.
///
/// One pass over a frame sums all regions at once, however many there are.
class RegionFusion {
 public:
  /// labels: CV_32SC1, >= 0, of the size of the frames.
  void begin(const cv::Mat& labels);

  /// frame: CV_8UC3, or CV_16UC3 in all calls; gray: CV_8UC1 of it.
  void add(const cv::Mat& frame, const cv::Mat& gray, int index);

  const cv::Mat& image() const { return image_; }
  cv::Mat sourceIndex() const;
  cv::Mat confidence() const;
  std::vector<RegionChoice> choices() const;  ///< of the labels that occur, ascending

 private:
  struct Run {  ///< pixels begin..end-1 of row y, all of one region
    int y, begin, end, region;
  };
  struct Region {
    int label;
    int frame = kNoFrame;
    double best = -1, second = -1;  ///< focus measures, -1 = none yet
    bool won = false;               ///< by the frame being added
  };

  double margin(const Region& region) const;
  template <typename Pixel, typename Value>
  cv::Mat paint(int type, Value value) const;

  cv::Size size_;
  std::vector<Run> runs_;
  std::vector<Region> regions_;
  std::vector<GraySums> sums_;
  cv::Mat image_;
};

}  // namespace all_in_focus::core
