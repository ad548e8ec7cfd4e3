// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <opencv2/core.hpp>
#include <thread>
#include <vector>

namespace all_in_focus {

/// Decodes numbered images on threads of its own while the caller works on the one before.
class ReadAhead {
 public:
  /// decode(i) returns image i, 0..count-1, and may throw. It is called from several threads at once.
  ReadAhead(int count, std::function<cv::Mat(int)> decode);
  ~ReadAhead();  ///< waits for the images that are being decoded
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  /// Keeps the first `count` images that get() returns for a second get(), up to `bytes` of them in all.
  void keepFirst(int count, std::size_t bytes);

  /// Waits for image i and returns it. The next images are decoded meanwhile. Throws what decode(i) threw.
  cv::Mat get(int i);

 private:
  struct Slot {
    enum { kEmpty, kBusy, kDone } state = kEmpty;
    bool kept = false;
    cv::Mat image;
    std::exception_ptr error;
  };

  void work();
  int nextToDecode() const;  ///< -1: nothing to do

  std::function<cv::Mat(int)> decode_;
  std::mutex mutex_;  // guards all that follows
  std::condition_variable changed_;
  std::vector<Slot> slots_;
  int wanted_ = 0;  // image that comes next
  int keep_count_ = 0;
  std::size_t keep_bytes_ = 0;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace all_in_focus
