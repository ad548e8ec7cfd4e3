// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/dof_segmentation.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "segmentation/adjacency_edges.hpp"
#include "segmentation/pixel_graph.hpp"
#include "segmentation/quasi_flat_zones.hpp"
#include "segmentation/region_statistics.hpp"

namespace all_in_focus::core {
namespace {

// Zones are found by the weight that this share of the edges does not exceed, those that break the rule again
// by half of it. Only speed depends on it, not the labels.
constexpr double kShare = 0.97;

}  // namespace

bool operator==(const SegmentationConfig& a, const SegmentationConfig& b) {
  return a.optics == b.optics && a.span == b.span && a.min_region_size == b.min_region_size &&
         a.merge_against_rule == b.merge_against_rule;
}

// How an image is segmented, in the terms of docs/algorithms.md:
//
//   depth -> PixelGraph       weights of the edges between neighbours
//         -> QuasiFlatZones   zones of pixels that are joined whatever the order: the nodes
//         -> AdjacencyEdges   edges between zones, sorted
//         -> merge            Kruskal's loop with the DoF rule: regions
//         -> RegionStatistics areas, medians, the label image
struct DofSegmentation::Work {
  PixelGraph graph;
  QuasiFlatZones zones;
  AdjacencyEdges edges;
  RegionStatistics statistics;
  std::vector<RegionNode> nodes;    // zones 1..node_count; parent: the region 1..region_count, in the end
  std::vector<RegionNode> regions;  // 1..region_count
  std::vector<RegionNode> merged;   // regions after small ones have been merged
  std::vector<int> areas;
  int node_count = 0, region_count = 0;

  RegionMap regionMap() const { return {graph, nodes.data(), node_count, regions.data(), region_count}; }

  void segment(const DofRule& rule, double focal_length_mm) {
    node_count = zones.find(graph, rule, std::max(0, graph.weightQuantile(kShare)), nodes);
    RegionNode* const node = nodes.data();
    int nearest = 65536, farthest = 0;  // mm
    for (int i = 1; i <= node_count; ++i) {
      nearest = std::min<int>(nearest, node[i].min);
      farthest = std::max<int>(farthest, node[i].max);
    }
    // Nothing at or before the focal length is ever sharp: such optics, or such depths, are a mistake.
    if (nearest <= focal_length_mm) {
      throw std::invalid_argument(
          cv::format("segmentation: the focal length, %g mm, is not smaller than the nearest depth, %d mm",
                     focal_length_mm, nearest));
    }
    edges.find(graph, std::max(0, farthest - nearest));
    for (const AdjacencyEdges::Edge& edge : edges) {
      const int a = findRoot(node, edge.a), b = findRoot(node, edge.b);
      if (a != b && rule.fits(std::min(node[a].min, node[b].min), std::max(node[a].max, node[b].max)))
        mergeRoots(node, a, b);
    }
    regions.resize(std::max(regions.size(), nodes.size() + 1));
    regions[0] = {0, 0, 0};
    region_count = relabelSets(node, node_count, regions.data());
  }

  // As printed in the paper: along the same edges, whatever the rule says.
  void mergeSmallRegions(int min_size) {
    areas = statistics.areas();
    const auto is_small = [&](int region) { return areas[region] < min_size; };
    for (const AdjacencyEdges::Edge& edge : edges) {
      const int a = findRoot(regions.data(), nodes[edge.a].parent),
                b = findRoot(regions.data(), nodes[edge.b].parent);
      if (a == b || (!is_small(a) && !is_small(b))) continue;
      mergeRoots(regions.data(), a, b);
      areas[std::min(a, b)] += areas[std::max(a, b)];
    }
    merged.resize(std::max(merged.size(), regions.size()));
    merged[0] = {0, 0, 0};
    region_count = relabelSets(regions.data(), region_count, merged.data());
    for (int i = 1; i <= node_count; ++i) nodes[i].parent = regions[nodes[i].parent].parent;
    std::swap(regions, merged);
    statistics.measure(regionMap());
  }
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
  work.segment(rule_, config_.optics.focal_length_mm);
  work.statistics.measure(work.regionMap());
  const std::vector<int>& areas = work.statistics.areas();
  if (config_.merge_against_rule && areas.size() > 1 &&
      *std::min_element(areas.begin() + 1, areas.end()) < config_.min_region_size) {
    work.mergeSmallRegions(config_.min_region_size);
  }
  work.statistics.describe(work.regionMap(), rule_, result);
}

std::vector<PlannedFocus> planFocus(const Optics& optics, const std::vector<Segment>& segments) {
  std::vector<DepthRange> ranges;
  ranges.reserve(segments.size());
  for (const Segment& segment : segments) {
    ranges.push_back({static_cast<double>(segment.min_mm), static_cast<double>(segment.max_mm)});
  }
  return planFocus(optics, std::move(ranges));
}

}  // namespace all_in_focus::core
