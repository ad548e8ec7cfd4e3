// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/sharpness_rows.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kSmallPx = 1.2, kAroundPx = 5;  // sigma
constexpr int kReduction = 4;

// Rows of the small window that the large one has read when it is at row y: up to six rows of the reduced
// image further down, and some above.
constexpr int kKept = 40;

// At n pixels that have neighbours on both sides.
ALL_IN_FOCUS_SIMD void laplacianOf(const std::uint8_t* north, const std::uint8_t* here,
                                   const std::uint8_t* south, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const int twice = 2 * here[i];
    out[i] = static_cast<float>(std::abs(twice - here[i - 1] - here[i + 1]) +
                                std::abs(twice - north[i] - south[i]));
  }
}

}  // namespace

void SharpnessRows::begin(const cv::Mat& gray) {
  if (gray.type() != CV_8UC1 || gray.empty()) {
    throw std::invalid_argument("sharpness: the image must be CV_8UC1 and not empty");
  }
  gray_ = gray;
  const cv::Size size = gray.size();
  reduced_size_ = {std::max(1, size.width / kReduction), std::max(1, size.height / kReduction)};
  window_.begin(size, kSmallPx);
  small_.begin(kKept, size.width);
  reduced_.begin(size, reduced_size_);
  window_around_.begin(reduced_size_, kAroundPx / kReduction);
  around_.begin(reduced_size_, size);
}

void SharpnessRows::laplacian(int y, float* out) const {
  // Beyond its border the picture is continued by its last row or column.
  const auto* here = gray_.ptr<std::uint8_t>(y);
  const auto* north = gray_.ptr<std::uint8_t>(std::max(y - 1, 0));
  const auto* south = gray_.ptr<std::uint8_t>(std::min(y + 1, gray_.rows - 1));
  const int last = gray_.cols - 1;
  if (last > 0) laplacianOf(north + 1, here + 1, south + 1, last - 1, out + 1);
  for (const int x : {0, last}) {
    const int across = 2 * here[x] - north[x] - south[x];
    const int along = 2 * here[x] - here[std::max(x - 1, 0)] - here[std::min(x + 1, last)];
    out[x] = static_cast<float>(std::abs(along) + std::abs(across));
  }
}

const float* SharpnessRows::small(int y) {
  return small_.row(y, [this](int v, float* out) {
    window_.row(
        v, [this](int w, float* row) { laplacian(w, row); }, out);
  });
}

void SharpnessRows::reduced(int y, float* out) {
  reduced_.row(
      y, [this](int v) { return small(v); }, out);
}

const float* SharpnessRows::around(int y) {
  return around_.row(y, [this](int v, float* out) {
    window_around_.row(
        v, [this](int w, float* row) { reduced(w, row); }, out);
  });
}

}  // namespace all_in_focus::core
