// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "all_in_focus/dof_segmentation.hpp"
#include "segmentation/pixel_graph.hpp"

namespace all_in_focus::core {

/// Which region each pixel of the graph belongs to: its label is a node, whose parent is the number of a
/// region, 0 for unknown depth. Regions 1..count are in the order of their first pixels.
struct RegionMap {
  const PixelGraph& graph;
  const RegionNode* nodes;
  int node_count;
  const RegionNode* regions;
  int count;

  int depths(int region) const { return regions[region].max - regions[region].min + 1; }
};

/// Areas and medians, labels from near to far, and the label image.
class RegionStatistics {
 public:
  void measure(const RegionMap& map);

  /// As measure(), when some of the regions measured last were joined: before[i].parent is the region that
  /// the former region i is in now.
  void join(const RegionMap& map, const RegionNode* before);

  const std::vector<int>& areas() const { return areas_; }  ///< pixels of regions 1..count

  /// Of what has been measured.
  void describe(const RegionMap& map, const DofRule& rule, Segmentation& result);

 private:
  bool layOut(const RegionMap& map);
  void countDepths(const RegionMap& map);
  void sumUp(const RegionMap& map);
  void sortDepths(const RegionMap& map);

  std::vector<int> areas_, medians_, begin_, min_, of_node_, order_, labels_;
  std::vector<int> begin_before_, min_before_, counts_before_;
  bool counted_ = false;
  std::vector<std::vector<int>> counts_;  ///< by strip
};

}  // namespace all_in_focus::core
