// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <opencv2/core/utility.hpp>

namespace all_in_focus::core {

/// Into how many strips to cut an image: one for each thread, as every strip costs some rows of its
/// neighbours, and none of few rows.
inline int stripCount(int rows) {
  constexpr int kLeastRows = 64;
  return std::clamp(rows / kLeastRows, 1, std::max(cv::getNumThreads(), 1));
}

/// body(rows, i) for each of `count` strips of the rows, in parallel.
template <typename Body>
void forStrips(const cv::Range& rows, int count, const Body& body) {
  const auto begin = [&](int i) { return rows.start + rows.size() * i / count; };
  cv::parallel_for_(
      cv::Range(0, count),
      [&](const cv::Range& strips) {
        for (int i = strips.start; i < strips.end; ++i) body(cv::Range(begin(i), begin(i + 1)), i);
      },
      count);
}

}  // namespace all_in_focus::core
