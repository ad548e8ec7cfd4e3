// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdlib>
#include <map>
#include <numeric>
#include <opencv2/core.hpp>
#include <tuple>
#include <vector>

#include "all_in_focus/dof_segmentation.hpp"

namespace all_in_focus::core {

/// The segmentation straight from its definition, over pixels and with the printed rule: slow and plain.
inline Segmentation referenceSegmentation(const cv::Mat& depth, const SegmentationConfig& config) {
  struct Edge {
    int weight, a, b;
  };
  const int rows = depth.rows, cols = depth.cols, pixels = rows * cols;
  const auto z = [&](int i) { return static_cast<int>(depth.at<std::uint16_t>(i / cols, i % cols)); };

  std::vector<Edge> edges;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x) {
      const int neighbours[4][2] = {{1, 0}, {-1, 1}, {0, 1}, {1, 1}};  // E, SW, S, SE
      for (const auto& [dx, dy] : neighbours) {
        if (x + dx < 0 || x + dx >= cols || y + dy >= rows) continue;
        const int a = y * cols + x, b = (y + dy) * cols + x + dx;
        if (z(a) != 0 && z(b) != 0) edges.push_back({std::abs(z(a) - z(b)), a, b});
      }
    }
  }
  std::stable_sort(edges.begin(), edges.end(),
                   [](const Edge& a, const Edge& b) { return a.weight < b.weight; });

  std::vector<int> parent(pixels), area(pixels, 1), min(pixels), max(pixels);
  std::iota(parent.begin(), parent.end(), 0);
  for (int i = 0; i < pixels; ++i) min[i] = max[i] = z(i);
  const auto find = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  const auto merge = [&](int a, int b) {
    parent[b] = a;
    area[a] += area[b];
    min[a] = std::min(min[a], min[b]);
    max[a] = std::max(max[a], max[b]);
  };
  // H diff < k min max, as integers where they are; see DofRule.
  const double span = config.span == DofSpan::kFull ? 2 : 1;
  const auto fits = [&](int low, int high) {
    return (high - low) * (hyperfocalDistance(config.optics) / span) < static_cast<double>(low) * high;
  };
  for (const Edge& edge : edges) {
    const int a = find(edge.a), b = find(edge.b);
    if (a != b && fits(std::min(min[a], min[b]), std::max(max[a], max[b]))) merge(a, b);
  }
  if (config.merge_against_rule) {
    for (const Edge& edge : edges) {
      const int a = find(edge.a), b = find(edge.b);
      if (a != b && (area[a] < config.min_region_size || area[b] < config.min_region_size)) merge(a, b);
    }
  }

  std::map<int, std::vector<int>> depths;  // by root
  std::map<int, int> first_pixel;
  Segmentation result;
  for (int i = 0; i < pixels; ++i) {
    if (z(i) == 0) {
      ++result.unknown_area;
      continue;
    }
    depths[find(i)].push_back(z(i));
    first_pixel.emplace(find(i), i);
  }
  std::vector<std::tuple<int, int, int>> order;  // median, first pixel, root
  for (auto& [root, values] : depths) {
    std::sort(values.begin(), values.end());
    order.emplace_back(values[(values.size() - 1) / 2], first_pixel[root], root);
  }
  std::sort(order.begin(), order.end());
  std::map<int, int> label_of;
  for (const auto& [median, first, root] : order) {
    const std::vector<int>& values = depths[root];
    const int label = static_cast<int>(label_of.size()) + 1;
    label_of[root] = label;
    result.segments.push_back({label, static_cast<int>(values.size()), values.front(), values.back(), median,
                               fits(values.front(), values.back())});
  }
  result.labels = cv::Mat::zeros(depth.size(), CV_32SC1);
  for (int i = 0; i < pixels; ++i) {
    if (z(i) != 0) result.labels.at<std::int32_t>(i / cols, i % cols) = label_of[find(i)];
  }
  return result;
}

}  // namespace all_in_focus::core
