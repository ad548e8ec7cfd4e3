// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "all_in_focus/optics.hpp"
#include "segmentation/pixel_graph.hpp"
#include "segmentation/tile_set.hpp"

namespace all_in_focus::core {

/// Groups of pixels joined by edges up to some weight. Those that break the rule are divided again by half
/// the weight, finally into equal depth.
///
/// With one weight for all, groups are regions whatever the order of merging: nothing can refuse a merge
/// inside a group, and nothing outside touches it before its own merges are over.
class PixelGrouping {
 public:
  /// Labels the graph 1..n in the order of first pixels, 0 where depth is unknown. regions[1..n] describe
  /// them. low: weight in the tiles; high: elsewhere, at least low, 0..254. The tiles of groups that would
  /// break the rule by more weight than low are added. Returns n.
  int compute(PixelGraph& graph, const DofRule& rule, int low, int high, TileSet& tiles,
              std::vector<RegionNode>& regions);

 private:
  struct Strip {
    std::vector<BlockRow> blocks[2];
    std::vector<std::uint8_t> links;
    std::vector<std::int32_t> parents;
    std::vector<std::uint32_t> listed;
    int first_number, numbers;
  };

  void lowerLimits(const PixelGraph& graph, int low, const TileSet& tiles);
  template <typename Cols>
  int findGroups(PixelGraph& graph, std::vector<RegionNode>& regions, const Cols& few_pixels);
  void findRow(const PixelGraph& graph, int y, BlockRow* blocks) const;
  void plantRows(PixelGraph& graph, const cv::Range& rows, Strip& strip) const;
  void joinRow(const PixelGraph& graph, int y, RegionNode* nodes);

  std::vector<Strip> strips_;
  std::vector<std::uint8_t> limits_;  // by pixel
  std::vector<std::uint8_t> broken_;  // by label
  TileSet of_broken_;
};

}  // namespace all_in_focus::core
