// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "read_ahead.hpp"

#include <algorithm>
#include <thread>
#include <utility>

namespace all_in_focus {
namespace {

constexpr int kMostKept = 8;  // half of a bracket; of a longer one, eight are not worth their memory
constexpr std::size_t kMostKeptBytes = 64 << 20;

}  // namespace

ReadAhead::ReadAhead(int count, std::function<cv::Mat(int)> decode)
    : count_(count), decode_(std::move(decode)) {
  begin(0);
}

void ReadAhead::begin(int i) {
  if (i < count_ && images_.count(i) == 0 && kept_.count(i) == 0)
    images_[i] = std::async(std::launch::async, decode_, i);
}

void ReadAhead::get(int i, cv::Mat& image) {
  image.release();
  begin(i);
  begin(i + 1);
  const bool is_first_time = i > farthest_;
  farthest_ = std::max(farthest_, i);
  if (const auto kept = kept_.find(i); kept != kept_.end()) {
    image = kept->second;
    kept_.erase(kept);
  } else {
    std::future<cv::Mat> wanted = std::move(images_.at(i));
    images_.erase(i);
    image = wanted.get();
    const std::size_t bytes = image.total() * image.elemSize();
    if (is_first_time && i < kMostKept && count_ <= 2 * kMostKept && kept_bytes_ + bytes <= kMostKeptBytes) {
      kept_bytes_ += bytes;
      kept_[i] = image;
    }
  }
  if (i + 1 == count_) kept_.clear();  // what follows may need the memory
  // Fusing an image takes longer than decoding the next, unless it has more than two cores.
  if (std::thread::hardware_concurrency() > 2) begin(i + 2);
}

}  // namespace all_in_focus
