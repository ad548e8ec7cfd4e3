// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/Image.h>

#include <algorithm>
#include <cstddef>
#include <deque>
#include <utility>
#include <vector>

namespace all_in_focus {

constexpr std::size_t kMaxWaitingBytes = 256 << 20;  ///< of one kind of image in one place
constexpr std::size_t kFewestWaiting = 4;            ///< images that may wait however large they are

/// How many images of this size may wait: fewer of large ones, so that memory stays limited.
inline std::size_t imageLimit(std::size_t most, std::size_t image_bytes) {
  const std::size_t fitting = kMaxWaitingBytes / std::max<std::size_t>(image_bytes, 1);
  return std::min(most, std::max(kFewestWaiting, fitting));
}
inline std::size_t imageLimit(std::size_t most, const sensor_msgs::Image& image) {
  return imageLimit(most, image.data.size());
}

/// Items that wait for their turn, oldest first, bounded by number and by bytes. Not thread-safe.
template <typename Item>
class WaitingList {
 public:
  explicit WaitingList(std::size_t most) : most_(std::max<std::size_t>(most, 1)) {}

  /// Returns the oldest items, which were removed to make room. The new one always stays.
  std::vector<Item> push(const Item& item, std::size_t bytes) {
    items_.emplace_back(item, bytes);
    bytes_ += bytes;
    std::vector<Item> dropped;
    while (items_.size() > most_ || (bytes_ > kMaxWaitingBytes && items_.size() > kFewestWaiting))
      dropped.push_back(pop());
    return dropped;
  }

  bool empty() const { return items_.empty(); }
  std::size_t size() const { return items_.size(); }
  const Item& operator[](std::size_t i) const { return items_[i].first; }

  /// Removes and returns the oldest item. The list must not be empty.
  Item pop() {
    Item item = std::move(items_.front().first);
    bytes_ -= items_.front().second;
    items_.pop_front();
    return item;
  }

  void clear() {
    items_.clear();
    bytes_ = 0;
  }

 private:
  std::size_t most_, bytes_ = 0;
  std::deque<std::pair<Item, std::size_t>> items_;
};

}  // namespace all_in_focus
