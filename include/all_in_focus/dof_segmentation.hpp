// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/focus_plan.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

/// One region of a label image.
struct Segment {
  int label = 0;      ///< 1.. from near to far by median depth (equal medians: by first pixel)
  int area = 0;       ///< pixels
  int min_mm = 0;     ///< nearest depth, mm
  int max_mm = 0;     ///< farthest depth, mm
  int median_mm = 0;  ///< lower median of the depths, mm
  bool fits = false;  ///< true if min_mm and max_mm fit the DoF rule
};

/// How regions are cut.
struct SegmentationConfig {
  Optics optics;                   ///< lens of the colour camera
  DofSpan span = DofSpan::kPaper;  ///< how much depth one region may span
  int min_region_size = 10;        ///< pixels; only used with merge_against_rule
  /// Merges smaller regions into a neighbour whatever the rule says, as printed in the paper. Otherwise they
  /// stay: the rule has refused every neighbour already, and will, because regions only grow.
  bool merge_against_rule = false;
};

/// True if all members are equal.
bool operator==(const SegmentationConfig& a, const SegmentationConfig& b);

/// A depth map divided into regions.
struct Segmentation {
  cv::Mat labels;                 ///< CV_32SC1: 1..segments.size(), 0 = depth unknown
  std::vector<Segment> segments;  ///< segments[i] has label i + 1
  int unknown_area = 0;           ///< pixels of label 0
};

/// Divides a depth map into regions that each fit inside one depth of field (section 2.2 of the paper).
///
/// The result is that of Kruskal's loop on the graph of 8 neighbours, as in Felzenszwalb and Huttenlocher,
/// Efficient Graph-Based Image Segmentation, IJCV 2004, with the DoF rule in place of their criterion: edges
/// are taken by weight, |depth difference|, and the regions at both ends are merged if they fit the rule
/// together. Edges of equal weight are taken in raster order of their first pixel, then E, SW, S, SE. Unknown
/// depth takes no part. docs/algorithms.md describes how this is computed without sorting all edges.
///
/// Buffers are reused between calls. Results depend neither on that nor on the number of threads. Not
/// thread-safe.
class DofSegmentation {
 public:
  /// Throws std::invalid_argument if validate() refuses the optics or min_region_size is negative.
  explicit DofSegmentation(const SegmentationConfig& config = {});
  ~DofSegmentation();
  DofSegmentation(DofSegmentation&&) noexcept;             ///< moves the buffers
  DofSegmentation& operator=(DofSegmentation&&) noexcept;  ///< moves the buffers

  /// depth: CV_16UC1 mm, 0 = unknown. Throws std::invalid_argument on another type, an empty image, or a
  /// known depth that does not lie beyond the focal length. result.labels is written in place if its size
  /// fits.
  void compute(const cv::Mat& depth, Segmentation& result);

  const SegmentationConfig& config() const { return config_; }  ///< as given

 private:
  struct Work;

  SegmentationConfig config_;
  DofRule rule_;
  std::unique_ptr<Work> work_;  ///< buffers
};

/// The fewest exposures that make every region sharp all over (focus_plan.hpp).
std::vector<PlannedFocus> planFocus(const Optics& optics, const std::vector<Segment>& segments);

}  // namespace all_in_focus::core
