// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/pixel_graph.hpp"

#include <algorithm>
#include <array>

namespace all_in_focus::core {
namespace {

constexpr int kMinStripRows = 32;

}  // namespace

WeightRow PixelGraph::weightRow(int y) const {
  const std::uint8_t* const row = &weights_[static_cast<std::size_t>(y) * 4 * stride()];
  return {row, row + stride(), row + 2 * stride(), row + 3 * stride()};
}

void PixelGraph::reset(const cv::Mat& depth) {
  depth_ = depth;
  strips_ = RowStrips({0, rows()}, stripCount(rows(), kMinStripRows));
  const std::size_t padded = static_cast<std::size_t>(rows() + 1) * stride();
  weights_.resize(4 * padded);
  labels_.resize(padded);

  strips_.forEach([&](const cv::Range& rows, int) {
    for (int y = rows.start; y < rows.end; ++y) {
      weighRow(y);
      labelRow(y)[cols()] = 0;
    }
  });
  std::fill_n(&weights_[static_cast<std::size_t>(rows()) * 4 * stride()], 4 * stride(), kHeavy);
  std::fill_n(labelRow(rows()), stride(), 0);
}

void PixelGraph::weighRow(int y) {
  std::uint8_t* const ab = &weights_[static_cast<std::size_t>(y) * 4 * stride()];
  std::uint8_t *const ac = ab + stride(), *const ad = ac + stride(), *const bc = ad + stride();
  // The last pixel has no neighbour to the right, and the column of unknown depth no edges at all.
  for (std::uint8_t* const weights : {ab, ac, ad, bc}) weights[cols() - 1] = weights[cols()] = kHeavy;
  const std::uint16_t* const row = depthRow(y);
  weighEdges(row, row + 1, cols() - 1, ab);
  if (y + 1 == rows()) {
    std::fill_n(ac, 3 * stride(), kHeavy);
    return;
  }
  const std::uint16_t* const below = depthRow(y + 1);
  weighEdges(row, below, cols(), ac);
  weighEdges(row, below + 1, cols() - 1, ad);
  weighEdges(row + 1, below, cols() - 1, bc);
}

int PixelGraph::weightQuantile(double share) const {
  std::array<int, 256> count{};
  int edges = 0;
  const int step = 1 + rows() / 32;
  for (int y = step / 2; y < rows(); y += step) {
    const std::uint8_t* const weight = weightRow(y).ac;
    const std::uint16_t* const depth = depthRow(y);
    for (int x = 0; x < cols(); ++x) {
      edges += depth[x] != 0;
      ++count[weight[x]];
    }
  }
  int weight = 0;
  for (int up_to = count[0]; weight < kHeavy && up_to <= share * edges; up_to += count[++weight]) {
  }
  return weight - 1;
}

}  // namespace all_in_focus::core
