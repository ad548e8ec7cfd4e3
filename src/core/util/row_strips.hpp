// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <opencv2/core/utility.hpp>

namespace all_in_focus::core {

/// Into how many strips to cut an image: one for each thread, as a strip may cost some rows of its
/// neighbours, and none of fewer rows than least_rows.
inline int stripCount(int rows, int least_rows = 64) {
  return std::clamp(rows / least_rows, 1, std::max(cv::getNumThreads(), 1));
}

/// Rows of an image, shared out among the threads.
class RowStrips {
 public:
  RowStrips() = default;
  RowStrips(const cv::Range& rows, int count) : rows_(rows), count_(count) {}

  int count() const { return count_; }
  cv::Range operator[](int strip) const { return {begin(strip), begin(strip + 1)}; }

  template <typename Work>
  void forEach(const Work& work) const {  ///< work(rows, strip), at the same time
    if (count_ == 1) return work(rows_, 0);
    cv::parallel_for_(
        cv::Range(0, count_),
        [this, &work](const cv::Range& strips) {
          for (int i = strips.start; i < strips.end; ++i) work((*this)[i], i);
        },
        count_);
  }

 private:
  int begin(int strip) const {
    return rows_.start + static_cast<int>(static_cast<long long>(rows_.size()) * strip / count_);
  }

  cv::Range rows_{0, 0};
  int count_ = 1;
};

}  // namespace all_in_focus::core
