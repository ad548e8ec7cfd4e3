// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/Image.h>

#include <algorithm>
#include <cstddef>

namespace all_in_focus {

/// How many images of this size may be kept of a kind: large ones fewer, so that memory stays bounded.
inline std::size_t imageLimit(std::size_t most, const sensor_msgs::Image& image) {
  constexpr std::size_t kMaxBytes = 256 << 20;
  constexpr std::size_t kFewest = 4;
  const std::size_t fitting = kMaxBytes / std::max<std::size_t>(image.data.size(), 1);
  return std::min(most, std::max(kFewest, fitting));
}

}  // namespace all_in_focus
