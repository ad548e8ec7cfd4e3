// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/focus_plan.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

/// One region of a label image. Depths in mm, over all its pixels.
struct Segment {
  int label = 0;  ///< 1.. from near to far by median depth (equal medians: by first pixel)
  int area = 0;   ///< pixels
  int min_mm = 0;
  int max_mm = 0;
  int median_mm = 0;  ///< lower median
  bool fits = false;  ///< the DoF rule holds
};

/// How regions are cut.
struct SegmentationConfig {
  Optics optics;
  DofSpan span = DofSpan::kPaper;
  int min_region_size = 10;         ///< pixels; smaller regions are merged into a neighbour...
  bool merge_against_rule = false;  ///< ...whatever the rule says (as printed). Otherwise they stay: the rule
                                    ///< has refused every neighbour already, and regions only grow.
};

bool operator==(const SegmentationConfig& a, const SegmentationConfig& b);

/// A label image and what is known of its regions.
struct Segmentation {
  cv::Mat labels;  ///< CV_32SC1, 0 = depth unknown, 1..segments.size()
  std::vector<Segment> segments;
  int unknown_area = 0;
};

/// Felzenszwalb and Huttenlocher's graph of 8 neighbours, weight |depth difference|, merged in ascending
/// order, with the DoF rule in place of their criterion (section 2.2). Equal weights are merged in raster
/// order of the first pixel, then E, SW, S, SE. Unknown depth (0) takes no part.
///
/// Buffers are reused between calls, and where regions met saves work in the next image of the same size: the
/// result does not depend on it. Not thread-safe.
class DofSegmentation {
 public:
  /// Throws std::invalid_argument on impossible optics or a negative size.
  explicit DofSegmentation(const SegmentationConfig& config = {});
  ~DofSegmentation();
  DofSegmentation(DofSegmentation&&) noexcept;
  DofSegmentation& operator=(DofSegmentation&&) noexcept;

  /// depth: CV_16UC1 mm, 0 = unknown, not empty, every depth beyond the focal length (else
  /// std::invalid_argument).
  void compute(const cv::Mat& depth, Segmentation& result);

  const SegmentationConfig& config() const { return config_; }

 private:
  struct Work;

  SegmentationConfig config_;
  DofRule rule_;
  std::unique_ptr<Work> work_;  ///< buffers, memory of the last image
};

/// The fewest exposures that make every region sharp all over (focus_plan.hpp).
std::vector<PlannedFocus> planFocus(const Optics& optics, const std::vector<Segment>& segments);

}  // namespace all_in_focus::core
