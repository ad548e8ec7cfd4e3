// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/tile_set.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {

void TileSet::resize(const cv::Size& image) {
  if (image == image_) return;
  image_ = image;
  tiles_.create((image.height + kSide - 1) / kSide, (image.width + kSide - 1) / kSide);
  addAll();
}

void TileSet::assign(const PixelGraph& graph, const std::uint8_t* flags) {
  clear();
  const RowStrips strips({0, tiles_.rows}, stripCount(tiles_.rows, 4));
  strips.forEach([&](const cv::Range& tile_rows, int) {
    const int last_row = std::min(tile_rows.end * kSide, graph.rows()), whole = graph.cols() / kSide;
    for (int y = tile_rows.start * kSide; y < last_row; ++y) {
      const std::int32_t* const labels = graph.labelRow(y);
      std::uint8_t* const tiles = tiles_[y / kSide];
      for (int i = 0; i < whole; ++i) {
        std::uint8_t any = 0;
        for (int x = i * kSide; x < (i + 1) * kSide; ++x) any |= flags[labels[x]];
        tiles[i] |= any;
      }
      for (int x = whole * kSide; x < graph.cols(); ++x) tiles[whole] |= flags[labels[x]];
    }
  });
}

void TileSet::dilate() {
  cv::dilate(tiles_, tiles_, cv::Mat());
}

bool TileSet::contains(const TileSet& other) const {
  return cv::countNonZero(other.tiles_ > tiles_) == 0;
}

}  // namespace all_in_focus::core
