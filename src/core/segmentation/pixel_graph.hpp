// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "segmentation/neighbour_rows.hpp"
#include "segmentation/region_forest.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {

/// Graph of the 8 neighbours of a depth image, and a label per pixel. A column of unknown depth at the right
/// and a row of it below spare the loops their special cases.
class PixelGraph {
 public:
  /// CV_16UC1 mm, 0 = unknown; used, not copied, until the next call.
  void reset(const cv::Mat& depth);

  int rows() const { return depth_.rows; }
  int cols() const { return depth_.cols; }
  int stride() const { return depth_.cols + 1; }  ///< from a label to the one below
  const RowStrips& strips() const { return strips_; }

  int nearest() const { return nearest_; }    ///< smallest known depth, mm; 65536 if there is none
  int farthest() const { return farthest_; }  ///< greatest depth, mm

  const std::uint16_t* depthRow(int y) const { return depth_.ptr<std::uint16_t>(y); }
  WeightRow weightRow(int y) const;  ///< up to row rows(), the one of unknown depth
  std::int32_t* labelRow(int y) { return &labels_[static_cast<std::size_t>(y) * stride()]; }
  const std::int32_t* labelRow(int y) const { return &labels_[static_cast<std::size_t>(y) * stride()]; }

  /// The greatest weight, up to 254, that at most `share` of the edges do not exceed, judged by a sample of
  /// them; -1 if even weight 0 is more frequent.
  int weightQuantile(double share) const;

  /// Every label becomes its node's parent.
  void relabel(const RegionNode* nodes);

 private:
  void weighRow(int y);

  cv::Mat depth_;
  RowStrips strips_;
  int nearest_ = 0, farthest_ = 0;
  std::vector<std::uint8_t> weights_;  // of each row: ab, ac, ad, bc
  std::vector<std::int32_t> labels_;
};

}  // namespace all_in_focus::core
