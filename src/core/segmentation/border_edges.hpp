// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "segmentation/pixel_graph.hpp"
#include "segmentation/tile_set.hpp"

namespace all_in_focus::core {

/// Edges between regions in Kruskal's order: by weight, then raster order of the first pixel, then E, SW, S,
/// SE.
///
/// Of the edges between the same two regions only the first one can change anything: the others find the two
/// merged, or refused, and refused once is refused for ever, because regions only grow. Not all others are
/// left out, only those that have an earlier one beside them.
class BorderEdges {
 public:
  struct Edge {
    int a, b;  ///< labels
  };
  struct Range {
    const Edge *first, *last;
    const Edge* begin() const { return first; }
    const Edge* end() const { return last; }
  };

  /// Edges up to `limit` mm, those whose first pixels lie in the tiles at least. The result holds until the
  /// next call.
  Range sorted(const PixelGraph& graph, int limit, const TileSet* tiles = nullptr);

  /// Where the edges of the last result that are heavier than `weight` begin.
  const Edge* heavierThan(int weight) const;

 private:
  struct WeightedEdge {
    int a, b, weight;
  };
  struct Strip {
    std::vector<std::uint8_t> same[2], edges;
    std::vector<BlockRow> blocks[2];
    std::vector<std::uint32_t> listed;
    std::vector<WeightedEdge> found;
    std::size_t count;
    std::vector<int> place;  ///< by weight: number of edges, then place of the next one
  };

  void find(const PixelGraph& graph, int limit, const TileSet* tiles, const cv::Range& rows, Strip& strip);
  void list(const PixelGraph& graph, int limit, int y, const cv::Range& cols, Strip& strip);

  std::vector<Strip> strips_;
  std::vector<Edge> sorted_;
};

}  // namespace all_in_focus::core
