// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "read_ahead.hpp"

#include <algorithm>
#include <utility>

namespace all_in_focus {
namespace {

// Images decoded before they are asked for: one for each thread. More would only take memory, as decoding is
// not slower than fusing by more than a factor of two.
constexpr int kThreads = 2, kAhead = kThreads;

}  // namespace

ReadAhead::ReadAhead(int count, std::function<cv::Mat(int)> decode)
    : decode_(std::move(decode)), slots_(count) {
  for (int i = 0; i < std::min(kThreads, count); ++i) threads_.emplace_back([this] { work(); });
}

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ReadAhead::keepFirst(int count, std::size_t bytes) {
  const std::lock_guard<std::mutex> lock(mutex_);
  keep_count_ = count;
  keep_bytes_ = bytes;
}

cv::Mat ReadAhead::get(int i) {
  std::unique_lock<std::mutex> lock(mutex_);
  wanted_ = i;
  changed_.notify_all();
  Slot& slot = slots_.at(i);
  changed_.wait(lock, [&slot] { return slot.state == Slot::kDone; });
  wanted_ = i + 1;
  if (slot.error) std::rethrow_exception(slot.error);
  cv::Mat image = slot.image;
  const std::size_t bytes = image.total() * image.elemSize();
  if (!slot.kept && i < keep_count_ && bytes <= keep_bytes_) {
    slot.kept = true;
    keep_bytes_ -= bytes;
  } else {
    slot.image = cv::Mat();
    slot.state = Slot::kEmpty;
  }
  changed_.notify_all();
  return image;
}

int ReadAhead::nextToDecode() const {
  const int end = std::min<int>(wanted_ + kAhead, static_cast<int>(slots_.size()));
  for (int i = wanted_; i < end; ++i) {
    if (slots_[i].state == Slot::kEmpty) return i;
  }
  return -1;
}

void ReadAhead::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return stopping_ || nextToDecode() >= 0; });
    if (stopping_) return;
    const int i = nextToDecode();
    slots_[i].state = Slot::kBusy;
    lock.unlock();
    cv::Mat image;
    std::exception_ptr error;
    try {
      image = decode_(i);
    } catch (...) {
      error = std::current_exception();
    }
    lock.lock();
    slots_[i].image = image;
    slots_[i].error = error;
    slots_[i].state = Slot::kDone;
    changed_.notify_all();
  }
}

}  // namespace all_in_focus
