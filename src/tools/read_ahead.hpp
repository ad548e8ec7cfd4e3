// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <future>
#include <map>
#include <opencv2/core.hpp>

namespace all_in_focus {

/// Decodes numbered images on threads of its own while the caller works on the one before. The frames before
/// the reference are read twice: of up to 16 images the first eight are kept until they are asked for again,
/// or until the last image is.
class ReadAhead {
 public:
  /// decode(i) returns image i, 0..count-1, and may throw. It is called from several threads at once.
  ReadAhead(int count, std::function<cv::Mat(int)> decode);
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  /// Releases `image`, waits for image i and puts it there. The next images are decoded until the call after.
  /// Throws what decode(i) threw.
  void get(int i, cv::Mat& image);

 private:
  void begin(int i);

  int count_;
  std::function<cv::Mat(int)> decode_;
  std::map<int, std::future<cv::Mat>> images_;  ///< being decoded; when destroyed, waits for them
  std::map<int, cv::Mat> kept_;
  std::size_t kept_bytes_ = 0;
  int farthest_ = -1;  ///< that was asked for
};

}  // namespace all_in_focus
