// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "all_in_focus/dof_segmentation.hpp"
#include "segmentation/pixel_graph.hpp"
#include "segmentation/quasi_flat_zones.hpp"

namespace all_in_focus::core {

/// Which region each pixel of the graph belongs to: its label is a node 1..node_count, whose parent is a
/// region 1..count. Regions are in the order of their first pixels. Label, node and region 0 stand for
/// unknown depth.
struct RegionMap {
  const PixelGraph& graph;
  const RegionNode* nodes;
  int node_count;
  const RegionNode* regions;
  int count;

  int depths(int region) const { return regions[region].max - regions[region].min + 1; }  ///< in its range
};

/// Areas and medians of regions, from histograms of their depths, and the label image.
class RegionStatistics {
 public:
  /// Measures areas and medians.
  void measure(const RegionMap& map);

  const std::vector<int>& areas() const { return areas_; }  ///< pixels by region, from 1 on

  /// Writes what has been measured, with labels from near to far.
  void describe(const RegionMap& map, const DofRule& rule, Segmentation& result);

 private:
  bool layOutHistograms(const RegionMap& map);
  void countDepths(const RegionMap& map);
  void readHistograms(const RegionMap& map);
  void sortDepths(const RegionMap& map);

  std::vector<int> areas_, medians_;        ///< by region
  std::vector<int> histogram_begin_, min_;  ///< by region: first bin, and the depth it stands for, mm
  std::vector<std::vector<int>>
      histograms_;  ///< by strip of rows: the histograms of all regions, one after another
  std::vector<int> of_node_, order_, labels_;
};

}  // namespace all_in_focus::core
