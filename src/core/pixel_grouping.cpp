// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "pixel_grouping.hpp"

#include <algorithm>

#include "simd.hpp"

namespace all_in_focus::core {
namespace {

int findRoot(std::int32_t* parents, int i) {
  int root = parents[i] = parents[parents[i]];
  while (parents[root] != root) root = parents[root] = parents[parents[root]];
  return root;
}

// Labels of known depth that are their own parents, `first` being the index of the first one.
ALL_IN_FOCUS_SIMD
int countRoots(const std::int32_t* labels, const std::uint16_t* depth, int first, int n) {
  int count = 0;
  for (int x = 0; x < n; ++x) count += (labels[x] == first + x) & (depth[x] != 0);
  return count;
}

// Labels become numbers of groups, counted on from `number`, the last one given, and the groups are
// described. Returns the last one. No branches but for holes: in noise they would be guessed wrong.
int numberRow(PixelGraph& graph, int y, bool equal_depth, int number, RegionNode* regions) {
  const std::uint16_t* const depth = graph.depthRow(y);
  std::int32_t* const labels = graph.labelRow(0);
  const int first = y * graph.stride(), cols = graph.cols();
  for (int x = 0; x < cols; ++x) {
    const std::uint16_t d = depth[x];
    if (d == 0) {
      labels[first + x] = 0;
      continue;
    }
    const int parent = labels[first + x];
    const bool root = parent == first + x;
    number += root;
    const int of_parent = labels[parent];
    const int label = labels[first + x] = root ? number : of_parent;
    if (equal_depth) {
      regions[label] = {label, d, d};
    } else {
      const int old = root - 1;  // all bits or none
      const int min = (regions[label].min | ~old) & 65535, max = regions[label].max & old;
      regions[label] = {label, static_cast<std::uint16_t>(d < min ? d : min),
                        static_cast<std::uint16_t>(d > max ? d : max)};
    }
  }
  return number;
}

}  // namespace

int PixelGrouping::compute(PixelGraph& graph, const DofRule& rule, int limit,
                           std::vector<RegionNode>& regions) {
  const std::size_t pixels = static_cast<std::size_t>(graph.rows() + 1) * graph.stride();
  limits_.assign(pixels, static_cast<std::uint8_t>(limit));
  for (;;) {
    const int count = findGroups(graph, limit == 0, regions);
    const auto breaks = [&](const RegionNode& region) { return !rule.fits(region.min, region.max); };
    bool any = false;
    for (int i = 1; i <= count; ++i) {
      regions[i].parent = regions[regions[i].parent].parent;
      any |= regions[i].parent == i && breaks(regions[i]);
    }
    if (!any) return count;
    const std::int32_t* const labels = graph.labelRow(0);
    graph.strips().forEach([&](const cv::Range& rows, int) {
      const std::int32_t* const end = graph.labelRow(rows.end);
      for (const std::int32_t* label = graph.labelRow(rows.start); label != end; ++label) {
        if (*label != 0 && breaks(regions[regions[*label].parent])) limits_[label - labels] /= 2;
      }
    });
  }
}

void PixelGrouping::findRow(const PixelGraph& graph, int y, BlockRow* blocks) const {
  const std::uint8_t* const limit = &limits_[static_cast<std::size_t>(y) * graph.stride()];
  findLinks(graph.weightRow(y), graph.weightRow(y + 1).ab, limit, limit + graph.stride(), graph.cols(),
            blocks);
}

// A forest of the pixels of some rows: labels become the indices of their parents.
void PixelGrouping::plantRows(PixelGraph& graph, const cv::Range& rows, Strip& strip) const {
  const int stride = graph.stride(), cols = graph.cols();
  const int back[] = {1, stride, stride - 1, stride + 1};
  for (auto& blocks : strip.blocks) blocks.assign(stride, 0);
  strip.links.assign(cols + 8, 0);
  strip.parents.resize(cols);
  strip.listed.resize(kMostBits(cols));
  BlockRow *above = &strip.blocks[0][1], *here = &strip.blocks[1][1];
  here[-1] = above[-1] = kAdmitsBd;
  std::int32_t* const labels = graph.labelRow(0);
  for (int y = rows.start; y < rows.end; ++y) {
    const int first = y * stride;
    findRow(graph, y, here);
    gatherLinks(here, above, cols, strip.links.data());
    takeFirstLinks(strip.links.data(), first, stride, cols, strip.parents.data());
    for (int x = 0; x < cols; ++x) {
      labels[first + x] = first + x;
      labels[first + x] = labels[strip.parents[x]];
    }
    const int others = listBits(strip.links.data(), cols, strip.listed.data());
    for (int i = 0; i < others; ++i) {
      const int pixel = first + strip.listed[i] / 8;
      const int a = findRoot(labels, pixel), b = findRoot(labels, pixel - back[strip.listed[i] % 8]);
      labels[std::max(a, b)] = std::min(a, b);
    }
    std::swap(above, here);
  }
}

int PixelGrouping::findGroups(PixelGraph& graph, bool equal_depth, std::vector<RegionNode>& regions) {
  const RowStrips& strips = graph.strips();
  strips_.resize(strips.count());
  strips.forEach([&](const cv::Range& rows, int i) {
    Strip& strip = strips_[i];
    plantRows(graph, rows, strip);
    strip.numbers = 0;
    for (int y = rows.start; y < rows.end; ++y)
      strip.numbers += countRoots(graph.labelRow(y), graph.depthRow(y), y * graph.stride(), graph.cols());
  });
  int count = 0;
  for (Strip& strip : strips_) {
    strip.first_number = count + 1;
    count += strip.numbers;
  }
  if (static_cast<int>(regions.size()) < count + 1) regions.resize(count + 1);
  regions[0] = {0, 0, 0};

  strips.forEach([&](const cv::Range& rows, int i) {
    int number = strips_[i].first_number - 1;
    for (int y = rows.start; y < rows.end; ++y)
      number = numberRow(graph, y, equal_depth, number, regions.data());
  });
  for (int i = 1; i < strips.count(); ++i) joinRow(graph, strips[i].start - 1, regions.data());
  return count;
}

// Links between the last row of a strip and the first one of the next.
void PixelGrouping::joinRow(const PixelGraph& graph, int y, RegionNode* regions) {
  const int stride = graph.stride();
  const int to[] = {1, stride - 1, stride, stride + 1};
  BlockRow* const blocks = &strips_[0].blocks[0][1];
  findRow(graph, y, blocks);
  std::uint8_t* const edges = strips_[0].links.data();
  gatherEdges(blocks, &strips_[0].blocks[1][1], graph.cols(), edges);
  const std::int32_t* const labels = graph.labelRow(y);
  const int count = listBits(edges, graph.cols(), strips_[0].listed.data());
  for (int i = 0; i < count; ++i) {
    const int x = strips_[0].listed[i] / 8, edge = strips_[0].listed[i] % 8;
    if (edge == 0) continue;
    const int a = core::findRoot(regions, labels[x]), b = core::findRoot(regions, labels[x + to[edge]]);
    if (a != b) uniteRoots(regions, a, b);
  }
}

}  // namespace all_in_focus::core
