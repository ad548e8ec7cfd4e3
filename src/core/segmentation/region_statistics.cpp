// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/region_statistics.hpp"

#include <algorithm>
#include <functional>
#include <numeric>

namespace all_in_focus::core {

void RegionStatistics::measure(const RegionMap& map) {
  if (layOut(map)) {
    countDepths(map);
    sumUp(map);
  } else {
    sortDepths(map);
  }
}

void RegionStatistics::join(const RegionMap& map, const RegionNode* before) {
  std::swap(begin_, begin_before_);
  std::swap(min_, min_before_);
  std::swap(counts_[0], counts_before_);
  const bool were_counted = counted_;
  if (!layOut(map) || !were_counted) return measure(map);
  std::vector<int>& counts = counts_[0];
  counts.assign(2 * static_cast<std::size_t>(begin_[map.count + 1]), 0);
  for (std::size_t i = 1; i + 1 < begin_before_.size(); ++i) {
    const int region = before[i].parent, first = begin_[region] - min_[region] + min_before_[i];
    const auto from = counts_before_.begin() + 2 * begin_before_[i];
    const auto to = counts.begin() + 2 * first;
    std::transform(from, from + 2 * (begin_before_[i + 1] - begin_before_[i]), to, to, std::plus<int>());
  }
  sumUp(map);
}

// Room for a count of each depth of each region. False for many regions of many depths each, as far away as
// nothing is out of focus.
bool RegionStatistics::layOut(const RegionMap& map) {
  areas_.assign(map.count + 1, 0);
  medians_.resize(map.count + 1);
  begin_.resize(map.count + 2);
  min_.resize(map.count + 1);
  std::int64_t total = 1;  // the first is for unknown depth
  const std::int64_t most = 65536 + static_cast<std::int64_t>(map.graph.rows()) * map.graph.cols();
  for (int i = 1; i <= map.count && total <= most; ++i) {
    begin_[i] = static_cast<int>(total);
    min_[i] = map.regions[i].min;
    total += map.depths(i);
  }
  begin_[map.count + 1] = static_cast<int>(total);
  counted_ = total <= most;
  counts_.resize(map.graph.strips().count());
  return counted_;
}

// Pixels of each region by depth.
void RegionStatistics::countDepths(const RegionMap& map) {
  of_node_.resize(map.node_count + 1);
  of_node_[0] = 0;
  for (int i = 1; i <= map.node_count; ++i) {
    const int region = map.nodes[i].parent;
    of_node_[i] = begin_[region] - min_[region];
  }
  map.graph.strips().forEach([&](const cv::Range& rows, int strip) {
    // Two counts, for neighbours: the same one twice in a row would have to wait for itself.
    counts_[strip].assign(2 * static_cast<std::size_t>(begin_[map.count + 1]), 0);
    int* const counts = counts_[strip].data();
    const int cols = map.graph.cols();
    const int* const of_node = of_node_.data();
    for (int y = rows.start; y < rows.end; ++y) {
      const std::int32_t* const labels = map.graph.labelRow(y);
      const std::uint16_t* const depth = map.graph.depthRow(y);
      for (int x = 0; x < cols; ++x) ++counts[2 * (of_node[labels[x]] + depth[x]) + (x & 1)];
    }
  });
  std::vector<int>& counts = counts_[0];
  for (std::size_t strip = 1; strip < counts_.size(); ++strip)
    std::transform(counts.begin(), counts.end(), counts_[strip].begin(), counts.begin(), std::plus<int>());
}

// Areas and medians from counts.
void RegionStatistics::sumUp(const RegionMap& map) {
  for (int i = 1; i <= map.count; ++i) {
    const int* const begin = &counts_[0][2 * begin_[i]];
    areas_[i] = std::accumulate(begin, begin + 2 * map.depths(i), 0);
    const int* depth = begin;
    for (int left = (areas_[i] + 1) / 2 - depth[0] - depth[1]; left > 0; left -= depth[0] + depth[1])
      depth += 2;
    medians_[i] = min_[i] + static_cast<int>(depth - begin) / 2;
  }
}

// Depths of each region.
void RegionStatistics::sortDepths(const RegionMap& map) {
  const auto forEachPixel = [&](const auto& use) {
    for (int y = 0; y < map.graph.rows(); ++y) {
      for (int x = 0; x < map.graph.cols(); ++x)
        use(map.nodes[map.graph.labelRow(y)[x]].parent, map.graph.depthRow(y)[x]);
    }
  };
  forEachPixel([&](int region, int) { ++areas_[region]; });
  begin_.assign(map.count + 2, 0);
  for (int i = 0; i <= map.count; ++i) begin_[i + 1] = begin_[i] + areas_[i];
  counts_.resize(1);
  std::vector<int>& depths = counts_[0];
  depths.resize(begin_[map.count + 1]);
  forEachPixel([&](int region, int depth) { depths[begin_[region]++] = depth; });
  for (int i = 1; i <= map.count; ++i) {
    const auto end = depths.begin() + begin_[i], begin = end - areas_[i];
    const auto median = begin + (areas_[i] - 1) / 2;
    std::nth_element(begin, median, end);
    medians_[i] = *median;
  }
}

void RegionStatistics::describe(const RegionMap& map, const DofRule& rule, Segmentation& result) {
  order_.resize(map.count);
  std::iota(order_.begin(), order_.end(), 1);
  std::sort(order_.begin(), order_.end(),
            [this](int a, int b) { return medians_[a] != medians_[b] ? medians_[a] < medians_[b] : a < b; });

  labels_.assign(map.count + 1, 0);
  result.segments.resize(map.count);
  result.unknown_area = map.graph.rows() * map.graph.cols();
  for (int i = 0; i < map.count; ++i) {
    const int region = order_[i];
    labels_[region] = i + 1;
    const int min = map.regions[region].min, max = map.regions[region].max;
    result.segments[i] = {i + 1, areas_[region], min, max, medians_[region], rule.fits(min, max)};
    result.unknown_area -= areas_[region];
  }
  of_node_.resize(map.node_count + 1);
  for (int i = 0; i <= map.node_count; ++i) of_node_[i] = labels_[map.nodes[i].parent];

  result.labels.create(map.graph.rows(), map.graph.cols(), CV_32SC1);
  const int* const of_node = of_node_.data();
  const int cols = map.graph.cols();
  map.graph.strips().forEach([&, of_node, cols](const cv::Range& rows, int) {
    for (int y = rows.start; y < rows.end; ++y) {
      const std::int32_t* const labels = map.graph.labelRow(y);
      std::int32_t* const row = result.labels.ptr<std::int32_t>(y);
      for (int x = 0; x < cols; ++x) row[x] = of_node[labels[x]];
    }
  });
}

}  // namespace all_in_focus::core
