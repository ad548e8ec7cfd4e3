// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "segmentation/edge_rows.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {

/// A depth image as a graph: pixels are nodes, each joined to its 8 neighbours by edges whose weight is the
/// difference of their depths. Holds a label per pixel as well.
///
/// Rows have one column more than the image, and there is one row more below it, both of unknown depth and of
/// label 0: loops over blocks of 2 x 2 pixels need no special case at the border.
class PixelGraph {
 public:
  /// Weighs all edges. depth: CV_16UC1 mm, 0 = unknown; it is used, not copied, until the next call. Labels
  /// are undefined until they are written.
  void reset(const cv::Mat& depth);

  int rows() const { return depth_.rows; }
  int cols() const { return depth_.cols; }
  int stride() const { return depth_.cols + 1; }  ///< from a label to the one below
  const RowStrips& strips() const { return strips_; }

  const std::uint16_t* depthRow(int y) const { return depth_.ptr<std::uint16_t>(y); }
  WeightRow weightRow(int y) const;                                                           ///< 0..rows()
  std::int32_t* labelRow(int y) { return &labels_[static_cast<std::size_t>(y) * stride()]; }  ///< 0..rows()
  const std::int32_t* labelRow(int y) const { return &labels_[static_cast<std::size_t>(y) * stride()]; }

  /// The greatest weight, up to 254 mm, such that at most this share (0..1) of the edges is no heavier,
  /// judged by the vertical edges of about 32 rows; -1 if even weight 0 is more frequent.
  int weightQuantile(double share) const;

 private:
  void weighRow(int y);

  cv::Mat depth_;
  RowStrips strips_;
  std::vector<std::uint8_t> weights_;  // by row: ab, ac, ad, bc of all its blocks
  std::vector<std::int32_t> labels_;
};

}  // namespace all_in_focus::core
