// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/border_edges.hpp"

#include <algorithm>
#include <cstdlib>

namespace all_in_focus::core {

BorderEdges::Range BorderEdges::sorted(const PixelGraph& graph, int limit, const TileSet* tiles) {
  const RowStrips& strips = graph.strips();
  strips_.resize(strips.count());
  limit = std::max(0, std::min(limit, graph.farthest() - graph.nearest()));
  strips.forEach([&](const cv::Range& rows, int i) { find(graph, limit, tiles, rows, strips_[i]); });
  int place = 0;
  for (int weight = 0; weight <= limit; ++weight) {
    for (Strip& strip : strips_) {
      const int count = strip.place[weight];
      strip.place[weight] = place;
      place += count;
    }
  }
  if (static_cast<int>(sorted_.size()) < place) sorted_.resize(place);
  strips.forEach([&](const cv::Range&, int i) {
    Strip& strip = strips_[i];
    int* const next = strip.place.data();
    Edge* const sorted = sorted_.data();
    for (std::size_t k = 0; k < strip.count; ++k) {
      const WeightedEdge& edge = strip.found[k];
      sorted[next[edge.weight]++] = {edge.a, edge.b};
    }
  });
  return {sorted_.data(), sorted_.data() + place};
}

const BorderEdges::Edge* BorderEdges::heavierThan(int weight) const {
  // Places have moved on to the next weight: its edges begin where the last strip's of this one end.
  const std::vector<int>& place = strips_.back().place;
  return sorted_.data() + place[std::min<std::size_t>(weight, place.size() - 1)];
}

void BorderEdges::find(const PixelGraph& graph, int limit, const TileSet* tiles, const cv::Range& rows,
                       Strip& strip) {
  const int stride = graph.stride();
  strip.place.assign(limit + 1, 0);
  strip.edges.assign(stride + 8, 0);
  strip.listed.resize(kMostBits(graph.cols()));
  for (auto& same : strip.same) same.resize(stride);
  for (auto& blocks : strip.blocks) blocks.resize(stride + 1);
  strip.count = 0;

  std::uint8_t *same = strip.same[0].data(), *same_below = strip.same[1].data();
  BlockRow *above = &strip.blocks[0][1], *here = &strip.blocks[1][1];
  const auto findSameFrom = [&graph](int y, const cv::Range& cols, std::uint8_t* to) {
    findSame(graph.labelRow(y) + cols.start, graph.labelRow(y + 1) + cols.start, cols.size(),
             to + cols.start);
    to[cols.end] = 0;
  };
  cv::Range before(0, 0);
  for (int y = rows.start; y < rows.end; ++y) {
    cv::Range cols = tiles == nullptr ? cv::Range(0, graph.cols()) : tiles->cols(y);
    if (cols.start > 0) --cols.start;  // a pixel's edge to the lower left belongs to the block before it
    if (cols != before) {              // what other blocks do not admit is not known: nothing
      std::fill_n(above - 1, stride, kAdmitsBd | kAdmitsCd);
      std::fill_n(here - 1, stride, kAdmitsBd | kAdmitsCd);
      std::fill(strip.edges.begin(), strip.edges.end(), 0);
      if (!cols.empty()) findSameFrom(y, cols, same);
      before = cols;
    }
    if (cols.empty()) continue;
    if (y + 1 < graph.rows()) findSameFrom(y + 1, cols, same_below);
    findBorders(graph.weightRow(y).from(cols.start), graph.weightRow(y + 1).ab + cols.start,
                same + cols.start, same_below + cols.start,
                static_cast<std::uint8_t>(std::min<int>(limit, kHeavy)), cols.size(), here + cols.start);
    gatherEdges(here + cols.start, above + cols.start, cols.size(), &strip.edges[cols.start]);
    list(graph, limit, y, cols, strip);
    std::swap(above, here);
    std::swap(same, same_below);
  }
}

// The edges of a row, in their order.
void BorderEdges::list(const PixelGraph& graph, int limit, int y, const cv::Range& cols, Strip& strip) {
  const int stride = graph.stride();
  const int to[] = {1, stride - 1, stride, stride + 1};
  if (strip.found.size() < strip.count + 4 * cols.size())
    strip.found.resize(2 * strip.count + 4 * cols.size());
  WeightedEdge* next = &strip.found[strip.count];
  const WeightRow weights = graph.weightRow(y);
  const std::uint8_t* const weight_of[] = {weights.ab, weights.bc - 1, weights.ac, weights.ad};
  const std::int32_t* const labels = graph.labelRow(y);
  int* const count_of = strip.place.data();
  const int listed = listBits(&strip.edges[cols.start], cols.size(), strip.listed.data());
  for (int i = 0; i < listed; ++i) {
    const int x = cols.start + static_cast<int>(strip.listed[i] / 8), edge = strip.listed[i] % 8;
    const int a = labels[x], b = labels[x + to[edge]];
    int weight = weight_of[edge][x];
    if (weight == kHeavy) {  // or unknown
      if (a == 0 || b == 0) continue;
      const int dx = edge == 1 ? -1 : edge == 2 ? 0 : 1;
      weight = std::abs(graph.depthRow(y)[x] - graph.depthRow(y + (edge != 0))[x + dx]);
      if (weight > limit) continue;
    }
    *next++ = {a, b, weight};
    ++count_of[weight];
  }
  strip.count = next - strip.found.data();
}

}  // namespace all_in_focus::core
