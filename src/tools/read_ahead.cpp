// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "read_ahead.hpp"

#include <thread>
#include <utility>

namespace all_in_focus {

ReadAhead::ReadAhead(int count, std::function<cv::Mat(int)> decode)
    : count_(count), decode_(std::move(decode)) {
  begin(0);
}

void ReadAhead::begin(int i) {
  if (i < count_ && images_.count(i) == 0) images_[i] = std::async(std::launch::async, decode_, i);
}

void ReadAhead::get(int i, cv::Mat& image) {
  image.release();
  begin(i);
  begin(i + 1);
  std::future<cv::Mat> wanted = std::move(images_.at(i));
  images_.erase(i);
  image = wanted.get();
  // Fusing an image takes longer than decoding the next, unless it has more than two cores.
  if (std::thread::hardware_concurrency() > 2) begin(i + 2);
}

}  // namespace all_in_focus
