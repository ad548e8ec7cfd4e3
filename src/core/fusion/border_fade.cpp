// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/border_fade.hpp"

#include <algorithm>

namespace all_in_focus::core {
namespace {

constexpr double kWidth = 0.5;  // over what the frame lacks

// Along one side of the picture.
std::vector<float> parts(const cv::Range& seen, int size) {
  std::vector<float> parts(static_cast<std::size_t>(size), 1);
  const auto part = [](int distance, int lacks) {
    return std::min(1.0, (distance + 0.5) / (kWidth * lacks));
  };
  for (int i = seen.start; i < seen.end; ++i) {
    parts[static_cast<std::size_t>(i)] =
        static_cast<float>(part(i - seen.start, seen.start) * part(seen.end - 1 - i, size - seen.end));
  }
  return parts;
}

}  // namespace

void BorderFade::begin(const cv::Rect& seen, const cv::Size& size) {
  columns_ = parts({seen.x, seen.br().x}, size.width);
  rows_ = parts({seen.y, seen.br().y}, size.height);
  columns_fade_ = *std::min_element(columns_.begin(), columns_.end()) < 1;
}

const float* BorderFade::row(int y, std::vector<float>& buffer) const {
  const float row = rows_[static_cast<std::size_t>(y)];
  if (row == 1) return columns_fade_ ? columns_.data() : nullptr;
  buffer.resize(columns_.size());
  std::transform(columns_.begin(), columns_.end(), buffer.begin(), [row](float part) { return row * part; });
  return buffer.data();
}

}  // namespace all_in_focus::core
