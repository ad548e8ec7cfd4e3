// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/pixel_grouping.hpp"

#include <algorithm>
#include <cstring>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

int findRoot(std::int32_t* parents, int i) {
  int root = parents[i] = parents[parents[i]];
  while (parents[root] != root) root = parents[root] = parents[parents[root]];
  return root;
}

// Each pixel of a row gets the parent of the pixel that it is linked to, `first` being the index of the first
// one; eight at once where all are linked to the west, as each would have to wait for the one before.
void takeParents(const BlockRow* blocks, const std::int32_t* linked_to, int n, int first,
                 std::int32_t* parents) {
  constexpr std::uint64_t all_linked = 0x0101010101010101 * kEast;
  const auto takeOne = [&](int x) {
    parents[first + x] = first + x;
    parents[first + x] = parents[linked_to[x]];
  };
  int x = 0;
  for (; x + 8 <= n; x += 8) {
    std::uint64_t to_west;
    std::memcpy(&to_west, blocks + x - 1, sizeof to_west);
    if ((to_west & all_linked) == all_linked) {
      std::fill_n(parents + first + x, 8, parents[first + x - 1]);
    } else {
      for (int i = 0; i < 8; ++i) takeOne(x + i);
    }
  }
  for (; x < n; ++x) takeOne(x);
}

// Labels of known depth that are their own parents, `first` being the index of the first one.
ALL_IN_FOCUS_SIMD
int countRoots(const std::int32_t* labels, const std::uint16_t* depth, int first, int n) {
  int count = 0;
  for (int x = 0; x < n; ++x) count += (labels[x] == first + x) & (depth[x] != 0);
  return count;
}

// Labels become numbers of groups, counted on from `number`, the last one given, and the groups are
// described. Returns the last one.
template <typename Describe>
int numberRow(PixelGraph& graph, int y, const cv::Range& cols, int number, const Describe& describe) {
  const std::uint16_t* const depth = graph.depthRow(y);
  std::int32_t* const labels = graph.labelRow(0);
  const int first = y * graph.stride();
  for (int x = cols.start; x < cols.end; ++x) {
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
    describe(label, root, d);
  }
  return number;
}

// Groups of a few pixels: no branches, they would be guessed wrong.
int numberSmall(PixelGraph& graph, int y, const cv::Range& cols, int number, RegionNode* regions) {
  return numberRow(graph, y, cols, number, [regions](int label, bool root, std::uint16_t d) {
    const int old = root - 1;  // all bits or none
    const int min = (regions[label].min | ~old) & 65535, max = regions[label].max & old;
    regions[label] = {label, static_cast<std::uint16_t>(d < min ? d : min),
                      static_cast<std::uint16_t>(d > max ? d : max)};
  });
}

// Groups of many pixels: few of them change anything, and writing what the next one reads would take longer.
int numberLarge(PixelGraph& graph, int y, const cv::Range& cols, int number, RegionNode* regions) {
  return numberRow(graph, y, cols, number, [regions](int label, bool root, std::uint16_t d) {
    RegionNode& region = regions[label];
    if (root) {
      region = {label, d, d};
    } else if ((d < region.min) | (d > region.max)) {
      region.min = std::min(region.min, d);
      region.max = std::max(region.max, d);
    }
  });
}

}  // namespace

int PixelGrouping::compute(PixelGraph& graph, const DofRule& rule, int low, int high, TileSet& tiles,
                           std::vector<RegionNode>& regions) {
  limits_.assign(static_cast<std::size_t>(graph.rows() + 1) * graph.stride(),
                 static_cast<std::uint8_t>(high));
  if (low < high) lowerLimits(graph, low, tiles);
  for (;;) {
    const int count = findGroups(graph, regions, [&](int y) {
      return low < high ? tiles.cols(y) : cv::Range(0, high > 0 ? graph.cols() : 0);
    });
    broken_.assign(count + 1, 0);
    bool any = false;
    for (int i = 1; i <= count; ++i) {
      const int root = regions[i].parent = regions[regions[i].parent].parent;
      broken_[i] = !rule.fits(regions[root].min, regions[root].max);
      any |= broken_[i] != 0;
    }
    if (!any) return count;
    if (low < high) {
      of_broken_.resize(cv::Size(graph.cols(), graph.rows()));
      of_broken_.assign(graph, broken_.data());
      if (!tiles.contains(of_broken_)) {
        tiles.add(of_broken_);
        lowerLimits(graph, low, tiles);
        continue;
      }
    }
    const std::int32_t* const labels = graph.labelRow(0);
    graph.strips().forEach([&](const cv::Range& rows, int) {
      const std::int32_t* const end = graph.labelRow(rows.end);
      for (const std::int32_t* label = graph.labelRow(rows.start); label != end; ++label)
        limits_[label - labels] >>= broken_[*label];
    });
  }
}

void PixelGrouping::lowerLimits(const PixelGraph& graph, int low, const TileSet& tiles) {
  graph.strips().forEach([&](const cv::Range& rows, int) {
    for (int y = rows.start; y < rows.end; ++y) {
      std::uint8_t* const row = &limits_[static_cast<std::size_t>(y) * graph.stride()];
      tiles.forEachIn(y, [&](const cv::Range& cols) {
        for (int x = cols.start; x < cols.end; ++x) row[x] = std::min(row[x], static_cast<std::uint8_t>(low));
      });
    }
  });
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
    takeParents(here, strip.parents.data(), cols, first, labels);
    const int others = listBits(strip.links.data(), cols, strip.listed.data());
    for (int i = 0; i < others; ++i) {
      const int pixel = first + strip.listed[i] / 8;
      const int a = findRoot(labels, pixel), b = findRoot(labels, pixel - back[strip.listed[i] % 8]);
      labels[std::max(a, b)] = std::min(a, b);
    }
    std::swap(above, here);
  }
}

// few_pixels(y): columns in which groups have few pixels.
template <typename Cols>
int PixelGrouping::findGroups(PixelGraph& graph, std::vector<RegionNode>& regions, const Cols& few_pixels) {
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
    for (int y = rows.start; y < rows.end; ++y) {
      const cv::Range few = few_pixels(y);
      number = numberLarge(graph, y, {0, few.start}, number, regions.data());
      number = numberSmall(graph, y, few, number, regions.data());
      number = numberLarge(graph, y, {few.end, graph.cols()}, number, regions.data());
    }
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
