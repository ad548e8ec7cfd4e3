// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <opencv2/core/utility.hpp>

namespace all_in_focus::core {

/// Number of strips to divide an image into: one for each thread, but none with fewer than min_rows rows. No
/// more, because a strip may have to compute some rows of its neighbours again.
inline int stripCount(int rows, int min_rows = 64) {
  return std::clamp(rows / min_rows, 1, std::max(cv::getNumThreads(), 1));
}

/// Calls work(i) for 0..count-1, such as rows, in parallel. parts: to divide them into, at most; < 0: any
/// number.
template <typename Work>
void inParallel(int count, const Work& work, double parts = -1) {
  cv::parallel_for_(
      cv::Range(0, count),
      [&work](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i) work(i);
      },
      parts);
}

/// Calls work(rows) for blocks of rows, in parallel. What a block needs stays in the cache.
template <typename Work>
void forEachBlock(const cv::Range& rows, const Work& work) {
  constexpr int kBlockRows = 64;
  inParallel((rows.size() + kBlockRows - 1) / kBlockRows, [&](int i) {
    const int start = rows.start + i * kBlockRows;
    work(cv::Range(start, std::min(start + kBlockRows, rows.end)));
  });
}

/// The rows of an image, divided evenly into strips, one for each thread.
class RowStrips {
 public:
  RowStrips() = default;
  RowStrips(const cv::Range& rows, int count) : rows_(rows), count_(count) {}

  int count() const { return count_; }
  cv::Range operator[](int strip) const { return {begin(strip), begin(strip + 1)}; }

  template <typename Work>
  void forEach(const Work& work) const {  ///< calls work(rows, strip) for all strips, in parallel
    if (count_ == 1) return work(rows_, 0);
    inParallel(
        count_, [&](int i) { work((*this)[i], i); }, count_);
  }

 private:
  int begin(int strip) const {
    return rows_.start + static_cast<int>(static_cast<long long>(rows_.size()) * strip / count_);
  }

  cv::Range rows_{0, 0};
  int count_ = 1;
};

}  // namespace all_in_focus::core
