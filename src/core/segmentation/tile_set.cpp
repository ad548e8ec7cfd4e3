// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segmentation/tile_set.hpp"

#include <algorithm>
#include <functional>

namespace all_in_focus::core {

void TileSet::resize(const cv::Size& image) {
  if (image == image_) return;
  image_ = image;
  rows_ = (image.height + kSide - 1) / kSide;
  cols_ = (image.width + kSide - 1) / kSide;
  tiles_.assign(static_cast<std::size_t>(rows_) * cols_, 1);
}

void TileSet::assign(const PixelGraph& graph, const std::uint8_t* flags) {
  clear();
  const RowStrips strips({0, rows_}, stripCount(rows_, 4));
  strips.forEach([&](const cv::Range& tile_rows, int) {
    const int last_row = std::min(tile_rows.end * kSide, graph.rows()), whole = graph.cols() / kSide;
    for (int y = tile_rows.start * kSide; y < last_row; ++y) {
      const std::int32_t* const labels = graph.labelRow(y);
      std::uint8_t* const tiles = row(y / kSide);
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
  above_.assign(cols_, 0);
  for (int y = 0; y < rows_; ++y) {
    std::uint8_t* const tiles = row(y);
    std::uint8_t left = 0;
    for (int x = 0; x < cols_; ++x) {
      const std::uint8_t here = tiles[x];
      tiles[x] |= left | (x + 1 < cols_ ? tiles[x + 1] : 0);
      left = here;
    }
  }
  for (int y = 0; y < rows_; ++y) {
    std::uint8_t* const tiles = row(y);
    const std::uint8_t* const below = y + 1 < rows_ ? row(y + 1) : tiles;
    for (int x = 0; x < cols_; ++x) {
      const std::uint8_t here = tiles[x];
      tiles[x] |= above_[x] | below[x];
      above_[x] = here;
    }
  }
}

void TileSet::add(const TileSet& other) {
  std::transform(tiles_.begin(), tiles_.end(), other.tiles_.begin(), tiles_.begin(),
                 std::bit_or<std::uint8_t>());
}

bool TileSet::contains(const TileSet& other) const {
  return std::equal(tiles_.begin(), tiles_.end(), other.tiles_.begin(),
                    [](std::uint8_t mine, std::uint8_t its) { return mine >= its; });
}

}  // namespace all_in_focus::core
