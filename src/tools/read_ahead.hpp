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

  /// Releases `image`, waits for image i and puts it there. The next images are decoded until the call after.
  /// Throws what decode(i) threw.
  void get(int i, cv::Mat& image);

 private:
  struct Slot {
    enum { kEmpty, kBusy, kDone } state = kEmpty;
    cv::Mat image;
    std::exception_ptr error;
  };

  void work();
  int nextToDecode() const;  ///< -1: nothing to do

  std::function<cv::Mat(int)> decode_;
  std::mutex mutex_;  // guards all that follows
  std::condition_variable changed_;
  std::vector<Slot> slots_;
  int wanted_ = 0;        // image that comes next
  bool awaited_ = false;  // the caller waits for it
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace all_in_focus
