// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/dof_segmentation.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "segmentation/border_edges.hpp"
#include "segmentation/pixel_graph.hpp"
#include "segmentation/pixel_grouping.hpp"
#include "segmentation/region_statistics.hpp"
#include "segmentation/tile_set.hpp"

namespace all_in_focus::core {
namespace {

// Only speed depends on these shares of the lightest edges. Up to the first they are merged without an order:
// with more than about two fifths of the edges of an image in noise, groups grow over whole surfaces and
// break the rule. Up to the second they are merged in order before all others. Up to the third they are
// merged without an order where regions did not meet in the image before.
constexpr double kUnorderedShare = 0.36, kFirstShare = 0.6, kCalmShare = 0.97;

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
  TileSet contested;  // where regions refused each other over light edges in the last image, and beside it
  TileSet tiles;
  std::vector<RegionNode> nodes;                // of the labels 1..node_count
  std::vector<RegionNode> trees;                // of the forest of nodes, 1..tree_count
  std::vector<RegionNode> joined;               // of the forest of trees
  std::vector<std::uint8_t> flags, tree_flags;  // of nodes, of trees
  std::vector<int> areas;
  int node_count = 0, tree_count = 0;

  // Outside the contested tiles all edges up to `high` are merged at once. This gives the regions of
  // Kruskal's order if none with a pixel there is refused over an edge up to `high`. For then each region
  // holds all along what it would hold in order, and perhaps more; so whatever is merged here would be merged
  // in order: it is smaller there, and fits, too. And a merge that is refused here would be refused in order,
  // as both regions are the same there by then: over a heavier edge than `high`, because all that was merged
  // before its time has had its time; over a lighter one, because both lie in the tiles and consist of groups
  // by one weight, which only heavier edges leave. Otherwise the scene has changed: all is done again, in
  // order.
  void merge(const DofRule& rule) {
    const cv::Size size(graph.cols(), graph.rows());
    contested.resize(size);
    tiles.resize(size);
    const int low = std::max(0, graph.weightQuantile(kUnorderedShare));
    const int first = std::max(low, graph.weightQuantile(kFirstShare));
    const int high = first > low ? graph.weightQuantile(kCalmShare) : low;
    while (!mergeFrom(rule, low, first, high)) contested.addAll();
  }

  bool mergeFrom(const DofRule& rule, int low, int first, int high) {
    node_count = grouping.compute(graph, rule, low, high, contested, nodes);
    const auto ignore = [](int, int) {};
    if (first > low && !contested.empty()) {
      // Only for speed. What lies elsewhere is not refused over such edges, whenever they come.
      mergeInOrder(rule, borders.sorted(graph, first, &contested), ignore);
      contract();
    }
    flags.assign(node_count + 1, 0);
    const BorderEdges::Range edges = borders.sorted(graph, 65535);
    const BorderEdges::Edge* const heavy = borders.heavierThan(high);
    mergeInOrder(rule, {edges.first, heavy}, [this](int a, int b) { flags[a] = flags[b] = 1; });
    mergeInOrder(rule, {heavy, edges.last}, ignore);
    countTrees();
    return high == low || learnContested();
  }

  // Kruskal's loop. refused(a, b): what to do about two roots that do not fit together.
  template <typename Refused>
  void mergeInOrder(const DofRule& rule, const BorderEdges::Range& edges, const Refused& refused) {
    RegionNode* const node = nodes.data();
    for (const BorderEdges::Edge& edge : edges) {
      const int a = findRoot(node, edge.a), b = findRoot(node, edge.b);
      if (a == b) continue;
      if (rule.fits(std::min(node[a].min, node[b].min), std::max(node[a].max, node[b].max))) {
        uniteRoots(node, a, b);
      } else {
        refused(a, b);
      }
    }
  }

  // The trees of flagged nodes refused each other. False if one has a pixel outside the tiles known.
  bool learnContested() {
    tree_flags.assign(tree_count + 1, 0);
    for (int i = 1; i <= node_count; ++i) tree_flags[nodes[i].parent] |= flags[i];
    if (std::find(tree_flags.begin(), tree_flags.end(), 1) == tree_flags.end()) {
      contested.clear();
      return true;
    }
    for (int i = 1; i <= node_count; ++i) flags[i] = tree_flags[nodes[i].parent];
    tiles.assign(graph, flags.data());
    const bool known = contested.contains(tiles);
    std::swap(contested, tiles);
    contested.widen();  // for what moves until the next image
    return known;
  }

  // As printed: along the same edge order, whatever the rule says.
  void mergeSmallRegions(int min_size) {
    areas = statistics.areas();
    const auto small = [&](int region) { return areas[region] < min_size; };
    for (int i = 1; i <= node_count; ++i) flags[i] = small(nodes[i].parent);
    tiles.assign(graph, flags.data());
    tiles.widen();  // an edge belongs to its first pixel
    for (const BorderEdges::Edge& edge : borders.sorted(graph, 65535, &tiles)) {
      const int a = findRoot(trees.data(), nodes[edge.a].parent),
                b = findRoot(trees.data(), nodes[edge.b].parent);
      if (a == b || (!small(a) && !small(b))) continue;
      uniteRoots(trees.data(), a, b);
      areas[std::min(a, b)] += areas[std::max(a, b)];
    }
    if (joined.size() < trees.size()) joined.resize(trees.size());
    tree_count = numberTrees(trees.data(), tree_count, joined.data());
    for (int i = 1; i <= node_count; ++i) nodes[i].parent = trees[nodes[i].parent].parent;
    std::swap(trees, joined);
    statistics.join(regionMap(), joined.data());
  }

  void countTrees() {
    if (trees.size() < nodes.size() + 1) trees.resize(nodes.size() + 1);
    trees[0] = {0, 0, 0};
    tree_count = numberTrees(nodes.data(), node_count, trees.data());
  }

  // Trees become nodes.
  void contract() {
    countTrees();
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
  work.merge(rule_);
  work.statistics.measure(work.regionMap());
  const std::vector<int>& areas = work.statistics.areas();
  if (config_.merge_against_rule && areas.size() > 1 &&
      *std::min_element(areas.begin() + 1, areas.end()) < config_.min_region_size) {
    work.mergeSmallRegions(config_.min_region_size);
  }
  work.statistics.describe(work.regionMap(), rule_, result);
}

}  // namespace all_in_focus::core
