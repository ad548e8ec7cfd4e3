// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/dof_segmentation.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "border_edges.hpp"
#include "pixel_graph.hpp"
#include "pixel_grouping.hpp"
#include "region_statistics.hpp"

namespace all_in_focus::core {
namespace {

// The share of the lightest edges that is merged first without an order, and then in order before all others.
// Only speed depends on them. With more than about two fifths of the edges of an image in noise, its groups
// grow over whole surfaces and break the rule.
constexpr double kUnorderedShare = 0.36, kFirstShare = 0.6;

}  // namespace

bool operator==(const SegmentationConfig& a, const SegmentationConfig& b) {
  return a.optics == b.optics && a.span == b.span && a.min_region_size == b.min_region_size &&
         a.merge_against_rule == b.merge_against_rule;
}

struct DofSegmentation::Work {
  PixelGraph graph;
  PixelGrouping grouping;
  BorderEdges borders;
  RegionStatistics statistics;
  std::vector<RegionNode> nodes;  // of the labels 1..node_count
  std::vector<RegionNode> trees;  // of the forest of nodes, 1..tree_count
  std::vector<int> areas;
  int node_count = 0, tree_count = 0;

  void group(const DofRule& rule) {
    const int limit = std::max(0, graph.weightQuantile(kUnorderedShare));
    node_count = grouping.compute(graph, rule, limit, nodes);
    const int next_limit = graph.weightQuantile(kFirstShare);
    if (next_limit <= limit) return;
    merge(rule, next_limit);
    contract();
  }

  void merge(const DofRule& rule, int limit) {
    RegionNode* const node = nodes.data();
    for (const BorderEdges::Edge& edge : borders.sorted(graph, limit)) {
      const int a = findRoot(node, edge.a), b = findRoot(node, edge.b);
      if (a != b && rule.fits(std::min(node[a].min, node[b].min), std::max(node[a].max, node[b].max)))
        uniteRoots(node, a, b);
    }
    countTrees();
  }

  // As printed: along the same edge order, whatever the rule says.
  void mergeSmallRegions(int min_size) {
    areas = statistics.areas();
    const auto small = [&](int region) { return areas[region] < min_size; };
    for (const BorderEdges::Edge& edge : borders.sorted(graph, 65535, areas.data(), min_size)) {
      const int a = findRoot(nodes.data(), edge.a), b = findRoot(nodes.data(), edge.b);
      if (a == b || (!small(a) && !small(b))) continue;
      uniteRoots(nodes.data(), a, b);
      areas[std::min(a, b)] += areas[std::max(a, b)];
    }
    countTrees();
  }

  void countTrees() {
    if (trees.size() < nodes.size() + 1) trees.resize(nodes.size() + 1);
    trees[0] = {0, 0, 0};
    tree_count = numberTrees(nodes.data(), node_count, trees.data());
  }

  // Trees become nodes.
  void contract() {
    graph.relabel(nodes.data());
    std::swap(nodes, trees);
    node_count = tree_count;
  }

  RegionMap regionMap() const { return {graph, nodes.data(), node_count, trees.data(), tree_count}; }
};

DofSegmentation::DofSegmentation(const SegmentationConfig& config)
    : config_(config), rule_(config.optics, config.span), work_(std::make_unique<Work>()) {
  validate(config.optics);
  if (config.min_region_size < 0) {
    throw std::invalid_argument("segmentation: min_region_size is negative: " +
                                std::to_string(config.min_region_size));
  }
}

DofSegmentation::DofSegmentation(DofSegmentation&&) noexcept = default;
DofSegmentation& DofSegmentation::operator=(DofSegmentation&&) noexcept = default;
DofSegmentation::~DofSegmentation() = default;

void DofSegmentation::compute(const cv::Mat& depth, Segmentation& result) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("segmentation: depth must be CV_16UC1 mm and not empty");
  }
  Work& work = *work_;
  work.graph.reset(depth);
  // Nothing at or before the focal length is ever sharp: such optics, or such depths, are a mistake.
  if (work.graph.nearest() <= config_.optics.focal_length_mm && work.graph.farthest() > 0) {
    throw std::invalid_argument(
        cv::format("segmentation: the focal length, %g mm, is not smaller than the nearest depth, %d mm",
                   config_.optics.focal_length_mm, work.graph.nearest()));
  }
  work.group(rule_);
  work.merge(rule_, 65535);
  work.statistics.measure(work.regionMap());
  const std::vector<int>& areas = work.statistics.areas();
  if (config_.merge_against_rule && areas.size() > 1 &&
      *std::min_element(areas.begin() + 1, areas.end()) < config_.min_region_size) {
    work.contract();
    work.mergeSmallRegions(config_.min_region_size);
    work.statistics.measure(work.regionMap());
  }
  work.statistics.describe(work.regionMap(), rule_, result);
}

}  // namespace all_in_focus::core
