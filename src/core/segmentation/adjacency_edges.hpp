// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "segmentation/pixel_graph.hpp"

namespace all_in_focus::core {

/// Edges of the region adjacency graph: those of the pixel graph that join two labels, in Kruskal's order,
/// which is by weight, then raster order of the first pixel, then E, SW, S, SE.
///
/// Two labels that lie side by side have many edges between them, of which only the first in order has an
/// effect: it merges the two regions, or it is refused, and then all others are, because regions only grow.
/// So an edge is left out where an earlier one between the same two labels lies in the same block of 2 x 2
/// pixels. That leaves some edges too many, which do no harm, and needs no table of pairs.
class AdjacencyEdges {
 public:
  struct Edge {
    int a, b;  ///< labels
  };

  /// Finds and sorts the edges between the graph's labels, none of which joins label 0 (unknown depth).
  /// max_weight: of all edges, >= 0.
  void find(const PixelGraph& graph, int max_weight);

  /// The result of the last find().
  const Edge* begin() const { return sorted_.data(); }
  const Edge* end() const { return sorted_.data() + count_; }

 private:
  struct WeightedEdge {
    int a, b, weight;
  };
  struct Strip {
    std::vector<std::uint8_t> same[2], edges;  ///< by column
    std::vector<BlockRow> blocks[2];
    std::vector<std::uint32_t> listed;
    std::vector<WeightedEdge> found;  ///< in raster order; `count` of them
    std::size_t count;
    std::vector<int> place;  ///< by weight: number of edges, then place of the next one in sorted_
  };

  void findInRows(const PixelGraph& graph, int max_weight, const cv::Range& rows, Strip& strip);
  void append(const PixelGraph& graph, int y, Strip& strip);

  std::vector<Strip> strips_;
  std::vector<Edge> sorted_;  ///< grows only
  int count_ = 0;
};

}  // namespace all_in_focus::core
