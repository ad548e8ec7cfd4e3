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
#include "segmentation/tile_set.hpp"

namespace all_in_focus::core {
namespace {

// Shares of the lightest edges of an image. Only speed depends on them, not labels.
//
// Up to the first share edges make quasi-flat zones everywhere. With more than about two fifths of the edges
// of a noisy image, zones grow over whole surfaces, break the rule and must be found again.
constexpr double kContestedShare = 0.36;
// An image is noisy if the weight changes up to this share. Without noise the first share has nearly all
// edges already, and contested tiles are not worth their time.
constexpr double kNoiseShare = 0.6;
// Up to this share edges of a noisy image make zones outside the contested tiles.
constexpr double kCalmShare = 0.97;

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
  TileSet contested;  // where regions refused each other over light edges in the last image, dilated
  TileSet refused_tiles;
  std::vector<RegionNode> nodes;    // zones 1..node_count; parent: the region 1..region_count, in the end
  std::vector<RegionNode> regions;  // 1..region_count
  std::vector<RegionNode> merged;   // regions after small ones have been merged
  std::vector<std::uint8_t> refused, region_refused;  // by node, by region: refused over a light edge
  std::vector<int> areas;
  int node_count = 0, region_count = 0;

  RegionMap regionMap() const { return {graph, nodes.data(), node_count, regions.data(), region_count}; }

  // In noise, zones by a limit that fits everywhere are small, and most time would go into sorting the edges
  // between them. Order matters only where regions refuse each other, though, and from image to image that is
  // in nearly the same tiles. So zones are found with the limit `high` outside the contested tiles of the
  // last image, and with `low` in them.
  //
  // The labels are those of Kruskal's order if no region that reaches outside the tiles is refused over a
  // light edge, one up to `high`. Compare, edge by edge, with Kruskal's loop over all edges:
  // * Zones only merge early what it merges in the end. So our regions contain its regions at any time, and
  //   what we merge fits the rule there, too, being smaller.
  // * What we refuse over a heavier edge it refuses: by then both have merged all light edges, and the
  //   regions are the same.
  // * What we refuse over a light edge it refuses: both regions lie in the tiles, where zones are by `low`
  //   and the edges that leave them are heavier, so nothing was merged early there.
  // If such a region does reach outside, the scene has changed: the image is segmented again with `low`.
  void segment(const DofRule& rule) {
    contested.resize({graph.cols(), graph.rows()});
    const int low = std::max(0, graph.weightQuantile(kContestedShare));
    const bool noisy = graph.weightQuantile(kNoiseShare) > low;
    const int high = noisy ? graph.weightQuantile(kCalmShare) : low;
    while (!segment(rule, low, high)) contested.addAll();
  }

  // False if a region outside the contested tiles is refused over a light edge.
  bool segment(const DofRule& rule, int low, int high) {
    node_count = zones.find(graph, rule, low, high, contested, nodes);
    edges.find(graph);
    refused.assign(node_count + 1, 0);
    const AdjacencyEdges::Edge* const heavy = edges.heavierThan(high);
    mergeAlong(edges.begin(), heavy, rule, [this](int a, int b) { refused[a] = refused[b] = 1; });
    mergeAlong(heavy, edges.end(), rule, [](int, int) {});
    regions.resize(std::max(regions.size(), nodes.size() + 1));
    regions[0] = {0, 0, 0};
    region_count = relabelSets(nodes.data(), node_count, regions.data());
    return high == low || findContested();
  }

  // Kruskal's loop. onRefusal(a, b): called with the roots of two regions that do not fit together.
  template <typename OnRefusal>
  void mergeAlong(const AdjacencyEdges::Edge* begin, const AdjacencyEdges::Edge* end, const DofRule& rule,
                  const OnRefusal& onRefusal) {
    RegionNode* const node = nodes.data();
    for (const AdjacencyEdges::Edge* edge = begin; edge != end; ++edge) {
      const int a = findRoot(node, edge->a), b = findRoot(node, edge->b);
      if (a == b) continue;
      if (rule.fits(std::min(node[a].min, node[b].min), std::max(node[a].max, node[b].max))) {
        mergeRoots(node, a, b);
      } else {
        onRefusal(a, b);
      }
    }
  }

  // The tiles of refused regions become the contested ones. False if one of them was not contested before.
  bool findContested() {
    region_refused.assign(region_count + 1, 0);
    for (int i = 1; i <= node_count; ++i) region_refused[nodes[i].parent] |= refused[i];
    for (int i = 1; i <= node_count; ++i) refused[i] = region_refused[nodes[i].parent];
    refused_tiles.resize({graph.cols(), graph.rows()});
    refused_tiles.assign(graph, refused.data());
    const bool known = contested.contains(refused_tiles);
    std::swap(contested, refused_tiles);
    contested.dilate();  // for what moves until the next image
    return known;
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
    statistics.merge(regionMap(), merged.data());
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
  // Nothing at or before the focal length is ever sharp: such optics, or such depths, are a mistake.
  if (work.graph.nearest() <= config_.optics.focal_length_mm && work.graph.farthest() > 0) {
    throw std::invalid_argument(
        cv::format("segmentation: the focal length, %g mm, is not smaller than the nearest depth, %d mm",
                   config_.optics.focal_length_mm, work.graph.nearest()));
  }
  work.segment(rule_);
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
