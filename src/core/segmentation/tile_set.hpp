// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <opencv2/core.hpp>

#include "segmentation/pixel_graph.hpp"

namespace all_in_focus::core {

/// A mask of an image at an eighth of its resolution: which tiles of 8 x 8 pixels belong to a set.
class TileSet {
 public:
  static constexpr int kSide = 8;  ///< pixels

  /// If the image has another size than before, the set then holds all its tiles.
  void resize(const cv::Size& image);

  void clear() { tiles_ = 0; }
  void addAll() { tiles_ = 1; }
  void add(const TileSet& other) { tiles_ |= other.tiles_; }

  /// Becomes the tiles that hold a pixel whose label is flagged. flags: 0 or 1 by label.
  void assign(const PixelGraph& graph, const std::uint8_t* flags);

  /// Adds the eight neighbours of each of its tiles.
  void dilate();

  bool contains(const TileSet& other) const;

  /// Calls visit(columns) for each of its tiles in row y of the image.
  template <typename Visit>
  void forEachIn(int y, const Visit& visit) const {
    const std::uint8_t* const tiles = tiles_[y / kSide];
    for (int i = 0; i < tiles_.cols; ++i) {
      if (tiles[i] != 0) visit(cv::Range(i * kSide, std::min((i + 1) * kSide, image_.width)));
    }
  }

 private:
  cv::Size image_;
  cv::Mat1b tiles_;  // 0 or 1
};

}  // namespace all_in_focus::core
