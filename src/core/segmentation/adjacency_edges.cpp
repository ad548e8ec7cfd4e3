// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/adjacency_edges.hpp"

#include <algorithm>
#include <cstdlib>

namespace all_in_focus::core {

// A counting sort: each strip of rows counts its edges by weight and then moves them to their places.
void AdjacencyEdges::find(const PixelGraph& graph, int max_weight) {
  const RowStrips& strips = graph.strips();
  strips_.resize(strips.count());
  strips.forEach([&](const cv::Range& rows, int i) { findInRows(graph, max_weight, rows, strips_[i]); });
  count_ = 0;
  for (int weight = 0; weight <= max_weight; ++weight) {
    for (Strip& strip : strips_) {
      const int count = strip.place[weight];
      strip.place[weight] = count_;
      count_ += count;
    }
  }
  if (static_cast<int>(sorted_.size()) < count_) sorted_.resize(count_);
  strips.forEach([&](const cv::Range&, int i) {
    Strip& strip = strips_[i];
    int* const place = strip.place.data();
    Edge* const sorted = sorted_.data();
    for (std::size_t k = 0; k < strip.count; ++k) {
      const WeightedEdge& edge = strip.found[k];
      sorted[place[edge.weight]++] = {edge.a, edge.b};
    }
  });
}

void AdjacencyEdges::findInRows(const PixelGraph& graph, int max_weight, const cv::Range& rows,
                                Strip& strip) {
  const int stride = graph.stride();
  strip.place.assign(max_weight + 1, 0);
  strip.edges.assign(stride + 8, 0);
  strip.listed.resize(kMostBits(graph.cols()));
  for (auto& same : strip.same) same.assign(stride, 0);
  // The row above the strip and the column before the image drop no edges.
  for (auto& blocks : strip.blocks) blocks.assign(stride + 1, kKeepsBd | kKeepsCd);
  strip.count = 0;

  std::uint8_t *same = strip.same[0].data(), *same_below = strip.same[1].data();
  BlockRow *above = &strip.blocks[0][1], *here = &strip.blocks[1][1];
  const auto findSameIn = [&graph](int y, std::uint8_t* to) {
    findSame(graph.labelRow(y), graph.labelRow(y + 1), graph.cols(), to);
  };
  findSameIn(rows.start, same);
  for (int y = rows.start; y < rows.end; ++y) {
    if (y + 1 < graph.rows()) findSameIn(y + 1, same_below);
    findAdjacencies(graph.weightRow(y), graph.weightRow(y + 1).ab, same, same_below, graph.cols(), here);
    gatherEdges(here, above, graph.cols(), strip.edges.data());
    append(graph, y, strip);
    std::swap(above, here);
    std::swap(same, same_below);
  }
}

// Appends the edges of row y to strip.found, in their order.
void AdjacencyEdges::append(const PixelGraph& graph, int y, Strip& strip) {
  const int stride = graph.stride();
  const int to[] = {1, stride - 1, stride, stride + 1};
  if (strip.found.size() < strip.count + 4 * stride) strip.found.resize(2 * strip.count + 4 * stride);
  WeightedEdge* next = &strip.found[strip.count];
  const WeightRow weights = graph.weightRow(y);
  const std::uint8_t* const weight_of[] = {weights.ab, weights.bc - 1, weights.ac, weights.ad};
  const std::int32_t* const labels = graph.labelRow(y);
  int* const count_of = strip.place.data();
  const int listed = listBits(strip.edges.data(), graph.cols(), strip.listed.data());
  for (int i = 0; i < listed; ++i) {
    const int x = static_cast<int>(strip.listed[i] / 8), edge = strip.listed[i] % 8;
    const int a = labels[x], b = labels[x + to[edge]];
    int weight = weight_of[edge][x];
    if (weight == kHeavy) {  // the byte does not tell the weight, or depth is unknown
      if (a == 0 || b == 0) continue;
      const int dx = edge == 1 ? -1 : edge == 2 ? 0 : 1;
      weight = std::abs(graph.depthRow(y)[x] - graph.depthRow(y + (edge != 0))[x + dx]);
    }
    *next++ = {a, b, weight};
    ++count_of[weight];
  }
  strip.count = next - strip.found.data();
}

}  // namespace all_in_focus::core
