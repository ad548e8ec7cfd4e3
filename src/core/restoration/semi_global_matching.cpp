// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/semi_global_matching.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kColorStep = 200;  // mean squared difference, gray levels squared
constexpr std::int16_t kFar = 16000;

// Path costs of a row of pixels, with one pixel and one level of padding on each side.
class PathRow {
 public:
  PathRow(int cols, int levels)
      : stride_(levels + 2), costs_((static_cast<size_t>(cols) + 2) * (levels + 2), 0), least_(cols + 2, 0) {
    for (size_t i = 0; i < costs_.size(); i += stride_) costs_[i] = costs_[i + levels + 1] = kFar;
  }
  std::int16_t* at(int x) { return &costs_[(static_cast<size_t>(x) + 1) * stride_ + 1]; }
  std::int16_t& least(int x) { return least_[x + 1]; }

 private:
  size_t stride_;
  std::vector<std::int16_t> costs_;
  std::vector<std::int16_t> least_;
};

// One step of a path. before: path costs of the previous pixel; least: their minimum. Adds the path costs of
// this pixel to `sum` and returns their minimum.
inline std::int16_t step(const std::int16_t* cost, const std::int16_t* before, std::int16_t least,
                         std::int16_t small_step, std::int16_t jump, int levels, std::int16_t* path,
                         std::int16_t* sum) {
  const std::int16_t jumped = static_cast<std::int16_t>(least + jump);
  std::int16_t found = kFar;
  for (int l = 0; l < levels; ++l) {
    const std::int16_t side = std::min(before[l - 1], before[l + 1]);
    const std::int16_t stepped = static_cast<std::int16_t>(side + small_step);
    const std::int16_t way = std::min(std::min(before[l], stepped), jumped);
    const std::int16_t here = static_cast<std::int16_t>(cost[l] + way - least);
    path[l] = here;
    sum[l] = static_cast<std::int16_t>(sum[l] + here);
    found = std::min(found, here);
  }
  return found;
}

// A row of one path. shift: column of the pixel before relative to this one.
ALL_IN_FOCUS_SIMD void walkRow(const std::int16_t* costs, PathRow& before, int shift, PathRow& path,
                               const std::int16_t* jump, std::int16_t small_step, int cols, int levels,
                               bool backwards, std::int16_t* sums) {
  for (int i = 0; i < cols; ++i) {
    const int x = backwards ? cols - 1 - i : i;
    path.least(x) =
        step(costs + static_cast<size_t>(x) * levels, before.at(x + shift), before.least(x + shift),
             small_step, jump[x], levels, path.at(x), sums + static_cast<size_t>(x) * levels);
  }
}

class JumpCosts {
 public:
  explicit JumpCosts(int jump) : table_(3 * 255 * 255 / kBin + 1) {
    for (size_t i = 0; i < table_.size(); ++i) {
      const double squared = static_cast<double>(i) * kBin / 3;
      table_[i] = static_cast<std::int16_t>(jump * std::exp(-squared / kColorStep));
    }
  }
  // Of the steps to the pixels of row y from those at (shift, rise) relative to them.
  void row(const cv::Mat3b& picture, int y, int shift, int rise, std::int16_t* out) const {
    const cv::Vec3b* here = picture[y];
    const cv::Vec3b* there = picture[std::clamp(y + rise, 0, picture.rows - 1)];
    for (int x = 0; x < picture.cols; ++x) {
      const cv::Vec3b& other = there[std::clamp(x + shift, 0, picture.cols - 1)];
      int squared = 0;
      for (int c = 0; c < 3; ++c) squared += (here[x][c] - other[c]) * (here[x][c] - other[c]);
      out[x] = table_[squared / kBin];
    }
  }

 private:
  static constexpr int kBin = 8;
  std::vector<std::int16_t> table_;
};

// The four paths that come from above, or, with everything mirrored, from below.
void walk(const CostVolume& costs, const cv::Mat3b& picture, const JumpCosts& jumps, std::int16_t small_step,
          bool up, CostVolume& sums) {
  const int cols = costs.size.width, rows = costs.size.height;
  const int back = up ? 1 : -1;  // rows and columns of the pixel before lie there
  std::vector<PathRow> above, path;
  for (int i = 0; i < 3; ++i) {
    above.emplace_back(cols, costs.levels);
    path.emplace_back(cols, costs.levels);
  }
  PathRow along(cols, costs.levels);
  std::vector<std::int16_t> jump(cols);
  for (int i = 0; i < rows; ++i) {
    const int y = up ? rows - 1 - i : i;
    std::int16_t* sum = sums.at(y, 0);
    std::fill_n(sum, static_cast<size_t>(cols) * costs.levels, std::int16_t{0});
    jumps.row(picture, y, back, 0, jump.data());
    walkRow(costs.at(y, 0), along, back, along, jump.data(), small_step, cols, costs.levels, up, sum);
    for (int k = 0; k < 3; ++k) {
      jumps.row(picture, y, k - 1, back, jump.data());
      walkRow(costs.at(y, 0), above[k], k - 1, path[k], jump.data(), small_step, cols, costs.levels, false,
              sum);
    }
    std::swap(above, path);
  }
}

}  // namespace

CostVolume aggregateAlongPaths(const CostVolume& costs, const cv::Mat3b& picture, int small_step, int jump) {
  const JumpCosts jumps(jump);
  std::array<CostVolume, 2> sums = {CostVolume(costs.size, costs.levels),
                                    CostVolume(costs.size, costs.levels)};
  inParallel(
      2, [&](int i) { walk(costs, picture, jumps, static_cast<std::int16_t>(small_step), i == 1, sums[i]); });
  sums[0].costs += sums[1].costs;
  return sums[0];
}

}  // namespace all_in_focus::core
