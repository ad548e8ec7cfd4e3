// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "border_edges.hpp"

#include <algorithm>
#include <cstdlib>

namespace all_in_focus::core {

BorderEdges::Range BorderEdges::sorted(const PixelGraph& graph, int limit, const int* areas, int small_area) {
  const RowStrips& strips = graph.strips();
  strips_.resize(strips.count());
  limit = std::max(0, std::min(limit, graph.farthest() - graph.nearest()));
  strips.forEach(
      [&](const cv::Range& rows, int i) { find(graph, limit, areas, small_area, rows, strips_[i]); });
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

void BorderEdges::find(const PixelGraph& graph, int limit, const int* areas, int small_area,
                       const cv::Range& rows, Strip& strip) {
  const int cols = graph.cols(), stride = graph.stride();
  const int to[] = {1, stride - 1, stride, stride + 1};
  strip.place.assign(limit + 1, 0);
  strip.edges.assign(cols + 8, 0);
  strip.listed.resize(kMostBits(cols));
  for (auto& same : strip.same) same.assign(stride, 0);
  for (auto& blocks : strip.blocks) blocks.assign(stride, kAdmitsBd | kAdmitsCd);
  strip.count = 0;

  std::uint8_t *same = strip.same[0].data(), *same_below = strip.same[1].data();
  BlockRow *above = &strip.blocks[0][1], *here = &strip.blocks[1][1];
  const int first = std::max(0, rows.start - 1);  // what the row above says about its edges cd
  findSame(graph.labelRow(first), graph.labelRow(first + 1), cols, same);
  for (int y = first; y < rows.end; ++y) {
    if (y + 1 < graph.rows()) findSame(graph.labelRow(y + 1), graph.labelRow(y + 2), cols, same_below);
    findBorders(graph.weightRow(y), graph.weightRow(y + 1).ab, same, same_below,
                static_cast<std::uint8_t>(std::min<int>(limit, kHeavy)), cols, here);
    if (y >= rows.start) {
      gatherEdges(here, above, cols, strip.edges.data());
      if (strip.found.size() < strip.count + 4 * cols) strip.found.resize(2 * strip.count + 4 * cols);
      WeightedEdge* next = &strip.found[strip.count];
      const WeightRow weights = graph.weightRow(y);
      const std::uint8_t* const weight_of[] = {weights.ab, weights.bc - 1, weights.ac, weights.ad};
      const std::int32_t* const labels = graph.labelRow(y);
      int* const count_of = strip.place.data();
      const int listed = listBits(strip.edges.data(), cols, strip.listed.data());
      for (int i = 0; i < listed; ++i) {
        const int x = strip.listed[i] / 8, edge = strip.listed[i] % 8;
        const int a = labels[x], b = labels[x + to[edge]];
        if (areas != nullptr && areas[a] >= small_area && areas[b] >= small_area) continue;
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
    std::swap(above, here);
    std::swap(same, same_below);
  }
}

}  // namespace all_in_focus::core
