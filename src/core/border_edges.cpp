// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "border_edges.hpp"

#include <algorithm>
#include <cstdlib>

namespace all_in_focus::core {

BorderEdges::Range BorderEdges::sorted(const PixelGraph& graph, int limit, const int* areas, int small_area) {
  const RowStripes& rows = graph.stripes();
  stripes_.resize(rows.count());
  limit = std::max(0, std::min(limit, graph.farthest() - graph.nearest()));
  rows.forEach(
      [&](int i) { find(graph, limit, areas, small_area, rows.begin(i), rows.end(i), stripes_[i]); });
  int place = 0;
  for (int weight = 0; weight <= limit; ++weight) {
    for (Stripe& stripe : stripes_) {
      const int count = stripe.place[weight];
      stripe.place[weight] = place;
      place += count;
    }
  }
  if (static_cast<int>(sorted_.size()) < place) sorted_.resize(place);
  rows.forEach([&](int i) {
    Stripe& stripe = stripes_[i];
    int* const next = stripe.place.data();
    Edge* const sorted = sorted_.data();
    for (std::size_t k = 0; k < stripe.count; ++k) {
      const WeightedEdge& edge = stripe.found[k];
      sorted[next[edge.weight]++] = {edge.a, edge.b};
    }
  });
  return {sorted_.data(), sorted_.data() + place};
}

void BorderEdges::find(const PixelGraph& graph, int limit, const int* areas, int small_area, int begin,
                       int end, Stripe& stripe) {
  const int cols = graph.cols(), stride = graph.stride();
  const int to[] = {1, stride - 1, stride, stride + 1};
  stripe.place.assign(limit + 1, 0);
  stripe.edges.assign(cols + 8, 0);
  stripe.listed.resize(kMostBits(cols));
  for (auto& same : stripe.same) same.assign(stride, 0);
  for (auto& blocks : stripe.blocks) blocks.assign(stride, kAdmitsBd | kAdmitsCd);
  stripe.count = 0;

  std::uint8_t *same = stripe.same[0].data(), *same_below = stripe.same[1].data();
  BlockRow *above = &stripe.blocks[0][1], *here = &stripe.blocks[1][1];
  const int first = std::max(0, begin - 1);  // what the row above says about its edges cd
  findSame(graph.labelRow(first), graph.labelRow(first + 1), cols, same);
  for (int y = first; y < end; ++y) {
    if (y + 1 < graph.rows()) findSame(graph.labelRow(y + 1), graph.labelRow(y + 2), cols, same_below);
    findBorders(graph.weightRow(y), graph.weightRow(y + 1).ab, same, same_below,
                static_cast<std::uint8_t>(std::min<int>(limit, kHeavy)), cols, here);
    if (y >= begin) {
      gatherEdges(here, above, cols, stripe.edges.data());
      if (stripe.found.size() < stripe.count + 4 * cols) stripe.found.resize(2 * stripe.count + 4 * cols);
      WeightedEdge* next = &stripe.found[stripe.count];
      const WeightRow weights = graph.weightRow(y);
      const std::uint8_t* const weight_of[] = {weights.ab, weights.bc - 1, weights.ac, weights.ad};
      const std::int32_t* const labels = graph.labelRow(y);
      int* const count_of = stripe.place.data();
      const int listed = listBits(stripe.edges.data(), cols, stripe.listed.data());
      for (int i = 0; i < listed; ++i) {
        const int x = stripe.listed[i] / 8, edge = stripe.listed[i] % 8;
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
      stripe.count = next - stripe.found.data();
    }
    std::swap(above, here);
    std::swap(same, same_below);
  }
}

}  // namespace all_in_focus::core
