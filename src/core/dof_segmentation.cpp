// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The graph is built over runs, not pixels: pixels of equal depth beside each other in a row are merged by
// the edges of weight 0, which come first and always fit the rule. On real Kinect depth a quarter of the
// nodes and a fifth of the edges are left. Of the edges between the same two runs only the first in order
// counts: it is merged or refused, and a refused edge stays refused because components only grow.

#include "all_in_focus/dof_segmentation.hpp"

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <stdexcept>
#include <string>

namespace all_in_focus::core {

DofSegmentation::DofSegmentation(const SegmentationConfig& config)
    : config_(config), rule_(config.optics, config.span) {
  validate(config.optics);
  if (config.min_region_size < 0) {
    throw std::invalid_argument("segmentation: min_region_size is negative: " +
                                std::to_string(config.min_region_size));
  }
}

void DofSegmentation::compute(const cv::Mat& depth, Segmentation& result) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("segmentation: depth must be CV_16UC1 mm and not empty");
  }
  findRuns(depth);
  requireBeyondFocalLength();
  findEdges(/*within_rule_only=*/true, [](int, int) { return true; });
  sortEdges();
  for (const Edge& edge : sorted_edges_) mergeIfFits(edge);
  if (config_.merge_against_rule && config_.min_region_size > 1) mergeSmallRegions();
  describe(depth.size(), result);
}

// Runs of equal depth in raster order; unknown depth (0) makes none.
void DofSegmentation::findRuns(const cv::Mat& depth) {
  runs_.clear();
  row_begin_.assign(1, 0);
  for (int y = 0; y < depth.rows; ++y) {
    const std::uint16_t* row = depth.ptr<std::uint16_t>(y);
    for (int x = 0; x < depth.cols;) {
      const std::uint16_t d = row[x];
      const int begin = x;
      while (++x < depth.cols && row[x] == d) {
      }
      if (d != 0) runs_.push_back({begin, x, d});
    }
    row_begin_.push_back(static_cast<int>(runs_.size()));
  }
  components_.resize(runs_.size());
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const Run& run = runs_[i];
    components_[i] = {static_cast<int>(i), run.end - run.begin, run.depth, run.depth};
  }
}

// Nothing at or before the focal length is ever sharp: such optics, or such depths, are a mistake.
void DofSegmentation::requireBeyondFocalLength() const {
  const auto nearest = std::min_element(runs_.begin(), runs_.end(),
                                        [](const Run& a, const Run& b) { return a.depth < b.depth; });
  if (nearest != runs_.end() && nearest->depth <= config_.optics.focal_length_mm) {
    throw std::invalid_argument(
        cv::format("segmentation: the focal length, %g mm, is not smaller than the nearest depth, %d mm",
                   config_.optics.focal_length_mm, nearest->depth));
  }
}

// Edges between runs in the order of their first pixel edge: raster order of the pixel, then E, SW, S, SE.
// Only pairs of runs that `wanted` admits.
template <typename Wanted>
void DofSegmentation::findEdges(bool within_rule_only, Wanted wanted) {
  edges_.clear();
  const auto add = [&](int a, int b) {
    const int da = runs_[a].depth, db = runs_[b].depth;
    if (within_rule_only && !rule_.fits(std::min(da, db), std::max(da, db))) return;
    if (wanted(a, b)) edges_.push_back({a, b, static_cast<std::uint16_t>(std::abs(da - db))});
  };
  const int rows = static_cast<int>(row_begin_.size()) - 1;
  for (int y = 0; y < rows; ++y) {
    int first_below = row_begin_[y + 1];
    const int end_below = y + 1 < rows ? row_begin_[y + 2] : first_below;
    for (int i = row_begin_[y]; i < row_begin_[y + 1]; ++i) {
      const Run& run = runs_[i];
      bool east_pending = i + 1 < row_begin_[y + 1] && runs_[i + 1].begin == run.end;
      // Runs below that touch [begin - 1, end]: the 8-neighbourhood.
      while (first_below < end_below && runs_[first_below].end < run.begin) ++first_below;
      for (int j = first_below; j < end_below && runs_[j].begin <= run.end; ++j) {
        const int first_pixel = std::max(run.begin, runs_[j].begin - 1);
        if (east_pending && first_pixel == run.end - 1) {
          add(i, i + 1);
          east_pending = false;
        }
        add(i, j);
      }
      if (east_pending) add(i, i + 1);
    }
  }
}

// Stable counting sort by weight.
void DofSegmentation::sortEdges() {
  weight_begin_.assign(65537, 0);
  for (const Edge& edge : edges_) ++weight_begin_[edge.weight + 1];
  std::partial_sum(weight_begin_.begin(), weight_begin_.end(), weight_begin_.begin());
  sorted_edges_.resize(edges_.size());
  for (const Edge& edge : edges_) sorted_edges_[weight_begin_[edge.weight]++] = edge;
}

int DofSegmentation::find(int run) {
  while (components_[run].parent != run)
    run = components_[run].parent = components_[components_[run].parent].parent;
  return run;
}

// The earlier run stays the root, so that a root is the first run of its component.
void DofSegmentation::merge(int a, int b) {
  if (b < a) std::swap(a, b);
  Component &to = components_[a], &from = components_[b];
  from.parent = a;
  to.area += from.area;
  to.min = std::min(to.min, from.min);
  to.max = std::max(to.max, from.max);
}

void DofSegmentation::mergeIfFits(const Edge& edge) {
  const int a = find(edge.a), b = find(edge.b);
  if (a == b) return;
  if (rule_.fits(std::min(components_[a].min, components_[b].min),
                 std::max(components_[a].max, components_[b].max))) {
    merge(a, b);
  }
}

// As printed: along the same edge order, whatever the rule says. Only edges at regions that are small now can
// matter.
void DofSegmentation::mergeSmallRegions() {
  const auto small = [this](int root) { return components_[root].area < config_.min_region_size; };
  findEdges(/*within_rule_only=*/false, [&](int a, int b) {
    const int root_a = find(a), root_b = find(b);
    return root_a != root_b && (small(root_a) || small(root_b));
  });
  sortEdges();
  for (const Edge& edge : sorted_edges_) {
    const int a = find(edge.a), b = find(edge.b);
    if (a != b && (small(a) || small(b))) merge(a, b);
  }
}

// Label image and statistics. Medians of all regions in one pass: runs in ascending depth, counted up per
// region.
void DofSegmentation::describe(const cv::Size& size, Segmentation& result) {
  const int runs = static_cast<int>(runs_.size());
  depth_begin_.assign(65537, 0);
  for (const Run& run : runs_) ++depth_begin_[run.depth + 1];
  std::partial_sum(depth_begin_.begin(), depth_begin_.end(), depth_begin_.begin());
  by_depth_.resize(runs);
  for (int i = 0; i < runs; ++i) by_depth_[depth_begin_[runs_[i].depth]++] = i;

  counted_.assign(runs, 0);
  roots_.clear();
  for (const int i : by_depth_) {
    const int root = find(i);
    const int half = (components_[root].area + 1) / 2;
    const int before = counted_[root];
    const int counted = before + runs_[i].end - runs_[i].begin;
    counted_[root] = counted;
    if (before < half && counted >= half) roots_.push_back({root, runs_[i].depth});
  }
  // Found in ascending order of their medians; equal ones are ordered by first pixel.
  std::stable_sort(roots_.begin(), roots_.end(), [](const RootMedian& a, const RootMedian& b) {
    return a.median != b.median ? a.median < b.median : a.root < b.root;
  });

  label_of_root_.resize(runs);
  result.segments.resize(roots_.size());
  int known = 0;
  for (std::size_t i = 0; i < roots_.size(); ++i) {
    const Component& component = components_[roots_[i].root];
    const int label = static_cast<int>(i) + 1;
    label_of_root_[roots_[i].root] = label;
    result.segments[i] = {label,         component.area,   component.min,
                          component.max, roots_[i].median, rule_.fits(component.min, component.max)};
    known += component.area;
  }
  result.unknown_area = size.area() - known;

  result.labels.create(size, CV_32SC1);
  for (int y = 0; y < size.height; ++y) {
    std::int32_t* const row = result.labels.ptr<std::int32_t>(y);
    int x = 0;
    for (int i = row_begin_[y]; i < row_begin_[y + 1]; ++i) {
      std::fill(row + x, row + runs_[i].begin, 0);
      std::fill(row + runs_[i].begin, row + runs_[i].end, label_of_root_[find(i)]);
      x = runs_[i].end;
    }
    std::fill(row + x, row + size.width, 0);
  }
}

}  // namespace all_in_focus::core
