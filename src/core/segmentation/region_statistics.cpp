// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/region_statistics.hpp"

#include <algorithm>
#include <functional>
#include <numeric>

namespace all_in_focus::core {

void RegionStatistics::measure(const RegionMap& map) {
  if (layOutHistograms(map)) {
    countDepths(map);
    readHistograms(map);
  } else {
    sortDepths(map);
  }
}

// Lays out a histogram for each region, with a bin for each mm of its depth range. False if they would be
// much larger than the image, as with many regions of many depths each where depth of field is wide.
bool RegionStatistics::layOutHistograms(const RegionMap& map) {
  areas_.assign(map.count + 1, 0);
  medians_.resize(map.count + 1);
  histogram_begin_.resize(map.count + 2);
  min_.resize(map.count + 1);
  std::int64_t total = 1;  // bin 0 is for unknown depth
  const std::int64_t most = 65536 + static_cast<std::int64_t>(map.graph.rows()) * map.graph.cols();
  for (int i = 1; i <= map.count && total <= most; ++i) {
    histogram_begin_[i] = static_cast<int>(total);
    min_[i] = map.regions[i].min;
    total += map.depths(i);
  }
  histogram_begin_[map.count + 1] = static_cast<int>(total);
  histograms_.resize(map.graph.strips().count());
  return total <= most;
}

// Fills the histograms, one set for each strip of rows, and adds them up in the first.
void RegionStatistics::countDepths(const RegionMap& map) {
  of_node_.resize(map.node_count + 1);
  of_node_[0] = 0;
  for (int i = 1; i <= map.node_count; ++i) {
    const int region = map.nodes[i].parent;
    of_node_[i] = histogram_begin_[region] - min_[region];
  }
  map.graph.strips().forEach([&](const cv::Range& rows, int strip) {
    histograms_[strip].assign(histogram_begin_[map.count + 1], 0);
    int* const counts = histograms_[strip].data();
    const int cols = map.graph.cols();
    const int* const of_node = of_node_.data();
    for (int y = rows.start; y < rows.end; ++y) {
      const std::int32_t* const labels = map.graph.labelRow(y);
      const std::uint16_t* const depth = map.graph.depthRow(y);
      for (int x = 0; x < cols; ++x) ++counts[of_node[labels[x]] + depth[x]];
    }
  });
  std::vector<int>& counts = histograms_[0];
  for (std::size_t strip = 1; strip < histograms_.size(); ++strip)
    std::transform(counts.begin(), counts.end(), histograms_[strip].begin(), counts.begin(),
                   std::plus<int>());
}

// Reads areas and medians from the histograms.
void RegionStatistics::readHistograms(const RegionMap& map) {
  for (int i = 1; i <= map.count; ++i) {
    const int* const histogram = &histograms_[0][histogram_begin_[i]];
    areas_[i] = std::accumulate(histogram, histogram + map.depths(i), 0);
    int bin = 0;
    for (int left = (areas_[i] + 1) / 2 - histogram[0]; left > 0; left -= histogram[bin]) ++bin;
    medians_[i] = min_[i] + bin;
  }
}

// Finds areas and medians without histograms, from the sorted depths of each region.
void RegionStatistics::sortDepths(const RegionMap& map) {
  std::vector<std::vector<std::uint16_t>> depths(map.count + 1);
  for (int y = 0; y < map.graph.rows(); ++y) {
    for (int x = 0; x < map.graph.cols(); ++x)
      depths[map.nodes[map.graph.labelRow(y)[x]].parent].push_back(map.graph.depthRow(y)[x]);
  }
  for (int i = 1; i <= map.count; ++i) {
    areas_[i] = static_cast<int>(depths[i].size());
    const auto median = depths[i].begin() + (areas_[i] - 1) / 2;
    std::nth_element(depths[i].begin(), median, depths[i].end());
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
