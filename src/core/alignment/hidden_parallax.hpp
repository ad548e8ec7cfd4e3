// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// What a pair of frames tells of the shifts of the cells of a grid over the picture, beside the pair's
/// motion.
struct CellShifts {
  static constexpr int kAcross = 16, kDown = 12;
  struct Cell {
    float xx = 0, xy = 0, yy = 0;  ///< information, 1/px^2
    float x = 0, y = 0;            ///< information times shift
  };
  std::array<Cell, static_cast<std::size_t>(kAcross) * kDown> cells;

  /// Adds a tile. x, y: its place as a share of the picture, 0..1; variance: that its shift has even where
  /// its pixels agree.
  void add(double x, double y, const cv::Matx22d& information, const cv::Vec2d& pull, double variance);
};

/// By how many pixels near and far things have moved against each other, at least; 0: no camera that moves
/// shows in these pairs. No depth is known. A refocusing lens moves each cell to and fro along a line of its
/// own: outwards, or across an edge whose blur changes. A camera that moves along a bent path bends the paths
/// of all cells, and all in the same sense, whether they are nearer or farther than the mean. The sense is
/// found in one half of the cells and tested in the other. A turn of the camera is eliminated. pairs: of one
/// scene; size: of the picture.
double hiddenParallax(const std::vector<const CellShifts*>& pairs, const cv::Size& size);

}  // namespace all_in_focus::core
