// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "all_in_focus/optics.hpp"
#include "pixel_graph.hpp"

namespace all_in_focus::core {

/// Groups of pixels that are one region whatever the order of merging: joined by edges up to some weight, all
/// others heavier, and within the rule altogether. Nothing can refuse a merge inside a group, and nothing
/// outside touches it before its own merges are over. Groups that break the rule are divided again by half
/// the weight, finally to equal depth.
class PixelGrouping {
 public:
  /// Labels the graph 1..n in the order of first pixels, 0 where depth is unknown. regions[1..n] describe
  /// them. limit: weight to begin with, 0..254. Returns n.
  int compute(PixelGraph& graph, const DofRule& rule, int limit, std::vector<RegionNode>& regions);

 private:
  struct Strip {
    std::vector<BlockRow> blocks[2];
    std::vector<std::uint8_t> links;
    std::vector<std::int32_t> parents;
    std::vector<std::uint32_t> listed;
    int first_number, numbers;
  };

  int findGroups(PixelGraph& graph, bool equal_depth, std::vector<RegionNode>& regions);
  void findRow(const PixelGraph& graph, int y, BlockRow* blocks) const;
  void plantRows(PixelGraph& graph, const cv::Range& rows, Strip& strip) const;
  void joinRow(const PixelGraph& graph, int y, RegionNode* nodes);

  std::vector<Strip> strips_;
  std::vector<std::uint8_t> limits_;
};

}  // namespace all_in_focus::core
