// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/Image.h>

#include <algorithm>
#include <cstddef>

namespace all_in_focus {

constexpr std::size_t kMaxWaitingBytes = 256 << 20;  ///< of one kind of image in one place
constexpr std::size_t kFewestWaiting = 4;            ///< images that may wait however large they are
constexpr int kMostWaiting = 1000;  ///< images, however small they are: the largest ~queue_size

/// How many images of this size may wait: fewer of large ones, so that memory stays limited.
inline std::size_t imageLimit(std::size_t most, const sensor_msgs::Image& image,
                              std::size_t most_bytes = kMaxWaitingBytes) {
  const std::size_t fitting = most_bytes / std::max<std::size_t>(image.data.size(), 1);
  return std::min(most, std::max(kFewestWaiting, fitting));
}

}  // namespace all_in_focus
