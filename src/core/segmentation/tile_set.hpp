// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "segmentation/pixel_graph.hpp"

namespace all_in_focus::core {

/// Some tiles of an image.
class TileSet {
 public:
  static constexpr int kSide = 8;  ///< pixels

  /// Holds all tiles when the image has another size than before.
  void resize(const cv::Size& image);

  void clear() { std::fill(tiles_.begin(), tiles_.end(), 0); }
  void addAll() { std::fill(tiles_.begin(), tiles_.end(), 1); }
  void add(const TileSet& others);

  /// Holds the tiles of pixels whose labels have a flag, 0 or 1, and no others.
  void assign(const PixelGraph& graph, const std::uint8_t* flags);

  /// Adds the neighbours of all its tiles.
  void widen();

  bool empty() const { return std::find(tiles_.begin(), tiles_.end(), 1) == tiles_.end(); }
  bool contains(const TileSet& other) const;

  /// Columns from its first tile in the row of pixels y to its last one.
  cv::Range cols(int y) const;

  /// visit(cols) for its tiles in the row of pixels y.
  template <typename Visit>
  void forEachIn(int y, const Visit& visit) const {
    const std::uint8_t* const tiles = row(y / kSide);
    for (int i = 0; i < cols_; ++i) {
      if (tiles[i] != 0) visit(cv::Range(i * kSide, std::min((i + 1) * kSide, image_.width)));
    }
  }

 private:
  std::uint8_t* row(int y) { return &tiles_[static_cast<std::size_t>(y) * cols_]; }
  const std::uint8_t* row(int y) const { return &tiles_[static_cast<std::size_t>(y) * cols_]; }

  cv::Size image_;
  int rows_ = 0, cols_ = 0;          // tiles
  std::vector<std::uint8_t> tiles_;  // 0 or 1
  std::vector<std::uint8_t> above_;
};

}  // namespace all_in_focus::core
