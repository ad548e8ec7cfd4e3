// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <opencv2/core/utility.hpp>

namespace all_in_focus::core {

/// Rows of an image, shared out among the threads.
class RowStripes {
 public:
  RowStripes() = default;
  explicit RowStripes(int rows)
      : rows_(rows), count_(std::max(1, std::min(cv::getNumThreads(), rows / 32))) {}

  int count() const { return count_; }
  int begin(int stripe) const { return static_cast<int>(static_cast<long long>(rows_) * stripe / count_); }
  int end(int stripe) const { return begin(stripe + 1); }

  template <typename Work>
  void forEach(const Work& work) const {  ///< work(stripe), at the same time
    if (count_ == 1) return work(0);
    cv::parallel_for_(
        cv::Range(0, count_),
        [&work](const cv::Range& stripes) {
          for (int i = stripes.start; i < stripes.end; ++i) work(i);
        },
        count_);
  }

 private:
  int rows_ = 0, count_ = 1;
};

}  // namespace all_in_focus::core
