// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

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

struct SegmentationConfig {
  Optics optics;
  DofSpan span = DofSpan::kPaper;
  int min_region_size = 10;         ///< pixels; smaller regions are merged into a neighbour...
  bool merge_against_rule = false;  ///< ...whatever the rule says (as printed). Otherwise they stay: the rule
                                    ///< has refused every neighbour already, and regions only grow.
};

struct Segmentation {
  cv::Mat labels;  ///< CV_32SC1, 0 = depth unknown, 1..segments.size()
  std::vector<Segment> segments;
  int unknown_area = 0;
};

/// Felzenszwalb and Huttenlocher's graph of 8 neighbours, weight |depth difference|, merged in ascending
/// order, with the DoF rule in place of their criterion (section 2.2). Equal weights are merged in raster
/// order of the first pixel, then E, SW, S, SE. Unknown depth (0) takes no part.
///
/// Buffers are reused between calls; not thread-safe.
class DofSegmentation {
 public:
  /// Throws std::invalid_argument on impossible optics or a negative size.
  explicit DofSegmentation(const SegmentationConfig& config = {});

  /// depth: CV_16UC1 mm, 0 = unknown, not empty, every depth beyond the focal length (else
  /// std::invalid_argument).
  void compute(const cv::Mat& depth, Segmentation& result);

  const SegmentationConfig& config() const { return config_; }

 private:
  struct Run {  ///< pixels begin..end-1 of one row, all of one depth
    int begin, end;
    std::uint16_t depth;
  };
  struct Component {  ///< union-find node; area, min and max hold at roots
    int parent, area;
    std::uint16_t min, max;
  };
  struct Edge {
    int a, b;  ///< runs
    std::uint16_t weight;
  };
  struct RootMedian {
    int root;
    std::uint16_t median;
  };

  void findRuns(const cv::Mat& depth);
  void requireBeyondFocalLength() const;
  template <typename Wanted>
  void findEdges(bool within_rule_only, Wanted wanted);
  void sortEdges();
  int find(int run);
  void merge(int a, int b);
  void mergeIfFits(const Edge& edge);
  void mergeSmallRegions();
  void describe(const cv::Size& size, Segmentation& result);

  SegmentationConfig config_;
  DofRule rule_;
  std::vector<Run> runs_;
  std::vector<int> row_begin_;  ///< first run of each row
  std::vector<Component> components_;
  std::vector<Edge> edges_, sorted_edges_;
  std::vector<int> weight_begin_, depth_begin_, by_depth_, label_of_root_;
  std::vector<int> counted_;  ///< pixels of a root so far
  std::vector<RootMedian> roots_;
};

}  // namespace all_in_focus::core
