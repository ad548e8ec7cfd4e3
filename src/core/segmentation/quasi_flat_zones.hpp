// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "all_in_focus/optics.hpp"
#include "segmentation/pixel_graph.hpp"
#include "util/disjoint_sets.hpp"

namespace all_in_focus::core {

/// Node of the disjoint sets of zones, and of regions. A root has the depth range of its set, mm.
struct RegionNode {
  int parent;
  std::uint16_t min, max;
};

/// Merges the regions of two roots.
inline void mergeRoots(RegionNode* nodes, int a, int b) {
  const int root = uniteRoots(nodes, a, b);
  const RegionNode& other = nodes[a + b - root];
  nodes[root].min = std::min(nodes[root].min, other.min);
  nodes[root].max = std::max(nodes[root].max, other.max);
}

/// Quasi-flat zones that fit the DoF rule. A quasi-flat zone is a connected component of the pixels under the
/// edges up to a limit: within it one can walk from any pixel to any other in steps of at most `limit` mm.
///
/// A zone that fits the rule as a whole is the start of one region, whatever the order of merging: nothing
/// can refuse a merge inside it, and all edges that leave it are heavier and come later. So its edges need
/// not be sorted, not even stored, and zones are found like any connected components, in parallel. A zone
/// that breaks the rule is divided by half the limit, again and again; at limit 0 it has one depth.
class QuasiFlatZones {
 public:
  /// Labels the graph with zones 1..n in the order of their first pixels, 0 where depth is unknown, and
  /// describes them in zones[1..n], each a set of its own. Returns n.
  ///
  /// limit: mm, 0..254.
  int find(PixelGraph& graph, const DofRule& rule, int limit, std::vector<RegionNode>& zones);

 private:
  struct Strip {
    std::vector<BlockRow> blocks[2];
    std::vector<std::uint8_t> links;
    std::vector<std::int32_t> linked_to;
    std::vector<std::uint32_t> listed;
    int first_zone, zones;
  };

  void halveBrokenLimits(const PixelGraph& graph);
  int label(PixelGraph& graph, std::vector<RegionNode>& zones);
  void findRow(const PixelGraph& graph, int y, BlockRow* blocks) const;
  void linkPixels(PixelGraph& graph, const cv::Range& rows, Strip& strip) const;
  void joinStrips(const PixelGraph& graph, int y, RegionNode* zones);

  std::vector<Strip> strips_;
  std::vector<std::uint8_t> limits_;  // by pixel
  std::vector<std::uint8_t> broken_;  // by zone: it breaks the rule
};

}  // namespace all_in_focus::core
