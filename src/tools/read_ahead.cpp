// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "read_ahead.hpp"

#include <algorithm>
#include <utility>

namespace all_in_focus {
namespace {

constexpr int kThreads = 2;

// Images decoded while the caller works at one. Fusing one takes longer than decoding the next, unless it has
// more than two cores.
int ahead() {
  return std::thread::hardware_concurrency() > 2 ? kThreads : 1;
}

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

void ReadAhead::get(int i, cv::Mat& image) {
  image.release();
  std::unique_lock<std::mutex> lock(mutex_);
  wanted_ = i;
  awaited_ = true;
  changed_.notify_all();
  Slot& slot = slots_.at(i);
  changed_.wait(lock, [&slot] { return slot.state == Slot::kDone; });
  wanted_ = i + 1;
  awaited_ = false;
  if (slot.error) std::rethrow_exception(slot.error);
  image = slot.image;
  slot = Slot();
  changed_.notify_all();
}

int ReadAhead::nextToDecode() const {
  const int last = wanted_ + (awaited_ ? kThreads : ahead());
  const int end = std::min<int>(last, static_cast<int>(slots_.size()));
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
