// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/quasi_flat_zones.hpp"

#include <algorithm>
#include <cstring>

#include "util/disjoint_sets.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

// Sets the parent of each pixel of a row to that of the pixel it is linked to. first: index of the first
// pixel. Where eight pixels in turn are linked to the west they are written at once: one by one, each would
// wait for the one before it.
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

// Counts the roots of known depth in a row. first: index of its first pixel.
ALL_IN_FOCUS_SIMD
int countRoots(const std::int32_t* parents, const std::uint16_t* depth, int first, int n) {
  int count = 0;
  for (int x = 0; x < n; ++x) count += (parents[x] == first + x) & (depth[x] != 0);
  return count;
}

// Turns the labels of a row, indices of parents, into numbers of zones, and extends the depth ranges of the
// zones. `last` is the last number that has been given; returns the new last one.
int numberRow(PixelGraph& graph, int y, int last, RegionNode* zones) {
  const std::uint16_t* const depth = graph.depthRow(y);
  std::int32_t* const labels = graph.labelRow(0);
  const int first = y * graph.stride();
  for (int x = 0; x < graph.cols(); ++x) {
    const std::uint16_t d = depth[x];
    if (d == 0) {
      labels[first + x] = 0;
      continue;
    }
    const int parent = labels[first + x];
    const bool is_root = parent == first + x;
    last += is_root;
    const int of_parent = labels[parent];
    RegionNode& zone = zones[labels[first + x] = is_root ? last : of_parent];
    if (is_root) {
      zone = {last, d, d};
    } else if ((d < zone.min) | (d > zone.max)) {
      zone.min = std::min(zone.min, d);
      zone.max = std::max(zone.max, d);
    }
  }
  return last;
}

}  // namespace

int QuasiFlatZones::find(PixelGraph& graph, const DofRule& rule, int limit, std::vector<RegionNode>& zones) {
  limits_.assign(static_cast<std::size_t>(graph.rows() + 1) * graph.stride(),
                 static_cast<std::uint8_t>(limit));
  for (;;) {
    const int count = label(graph, zones);
    broken_.assign(count + 1, 0);
    bool any = false;
    for (int i = 1; i <= count; ++i) {
      const int root = zones[i].parent = findRoot(zones.data(), i);
      broken_[i] = !rule.fits(zones[root].min, zones[root].max);
      any |= broken_[i] != 0;
    }
    if (!any) return count;
    halveBrokenLimits(graph);
  }
}

void QuasiFlatZones::halveBrokenLimits(const PixelGraph& graph) {
  const std::int32_t* const labels = graph.labelRow(0);
  graph.strips().forEach([&](const cv::Range& rows, int) {
    const std::int32_t* const end = graph.labelRow(rows.end);
    for (const std::int32_t* label = graph.labelRow(rows.start); label != end; ++label) {
      if (broken_[*label] != 0) limits_[label - labels] /= 2;
    }
  });
}

// Connected components in two passes over each strip of rows: disjoint sets of pixels first, their numbers
// then. Zones that reach across strips are united last.
int QuasiFlatZones::label(PixelGraph& graph, std::vector<RegionNode>& zones) {
  const RowStrips& strips = graph.strips();
  strips_.resize(strips.count());
  strips.forEach([&](const cv::Range& rows, int i) {
    Strip& strip = strips_[i];
    linkPixels(graph, rows, strip);
    strip.zones = 0;
    for (int y = rows.start; y < rows.end; ++y)
      strip.zones += countRoots(graph.labelRow(y), graph.depthRow(y), y * graph.stride(), graph.cols());
  });
  int count = 0;
  for (Strip& strip : strips_) {
    strip.first_zone = count + 1;
    count += strip.zones;
  }
  if (static_cast<int>(zones.size()) < count + 1) zones.resize(count + 1);
  zones[0] = {0, 0, 0};

  strips.forEach([&](const cv::Range& rows, int i) {
    int last = strips_[i].first_zone - 1;
    for (int y = rows.start; y < rows.end; ++y) last = numberRow(graph, y, last, zones.data());
  });
  for (int i = 1; i < strips.count(); ++i) joinStrips(graph, strips[i].start - 1, zones.data());
  return count;
}

void QuasiFlatZones::findRow(const PixelGraph& graph, int y, BlockRow* blocks) const {
  const std::uint8_t* const limit = &limits_[static_cast<std::size_t>(y) * graph.stride()];
  findLinks(graph.weightRow(y), graph.weightRow(y + 1).ab, limit, limit + graph.stride(), graph.cols(),
            blocks);
}

// Disjoint sets of the pixels of some rows: labels become the indices of their parents. Each pixel takes the
// parent of its first link, as a whole row at a time can; the few other links are followed one by one.
void QuasiFlatZones::linkPixels(PixelGraph& graph, const cv::Range& rows, Strip& strip) const {
  const int stride = graph.stride(), cols = graph.cols();
  const int back[] = {1, stride, stride - 1, stride + 1};  // by bit of LinkBit
  for (auto& blocks : strip.blocks) blocks.assign(stride, 0);
  strip.links.assign(cols + 8, 0);
  strip.linked_to.resize(cols);
  strip.listed.resize(kMostBits(cols));
  BlockRow *above = &strip.blocks[0][1], *here = &strip.blocks[1][1];
  here[-1] = above[-1] = kKeepsBd;
  std::int32_t* const labels = graph.labelRow(0);
  for (int y = rows.start; y < rows.end; ++y) {
    const int first = y * stride;
    findRow(graph, y, here);
    gatherLinks(here, above, cols, strip.links.data());
    takeFirstLinks(strip.links.data(), first, stride, cols, strip.linked_to.data());
    takeParents(here, strip.linked_to.data(), cols, first, labels);
    const int others = listBits(strip.links.data(), cols, strip.listed.data());
    for (int i = 0; i < others; ++i) {
      const int pixel = first + strip.listed[i] / 8;
      uniteRoots(labels, findRoot(labels, pixel), findRoot(labels, pixel - back[strip.listed[i] % 8]));
    }
    std::swap(above, here);
  }
}

// Unites zones over the links between row y, the last one of a strip, and the next.
void QuasiFlatZones::joinStrips(const PixelGraph& graph, int y, RegionNode* zones) {
  const int stride = graph.stride();
  const int to[] = {1, stride - 1, stride, stride + 1};  // by bit of EdgeBit
  Strip& strip = strips_[0];
  BlockRow* const blocks = &strip.blocks[0][1];
  findRow(graph, y, blocks);
  gatherEdges(blocks, &strip.blocks[1][1], graph.cols(), strip.links.data());
  const std::int32_t* const labels = graph.labelRow(y);
  const int count = listBits(strip.links.data(), graph.cols(), strip.listed.data());
  for (int i = 0; i < count; ++i) {
    const int x = strip.listed[i] / 8, edge = strip.listed[i] % 8;
    if (edge == 0) continue;  // along the row
    const int a = findRoot(zones, labels[x]), b = findRoot(zones, labels[x + to[edge]]);
    if (a != b) mergeRoots(zones, a, b);
  }
}

}  // namespace all_in_focus::core
