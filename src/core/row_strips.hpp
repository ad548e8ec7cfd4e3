// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <opencv2/core/utility.hpp>

namespace all_in_focus::core {

/// Into how many strips to cut an image for the threads there are. Each costs some rows of its neighbours, so
/// that strips are not to be low.
inline int stripCount(int rows) {
  constexpr int kLeastRows = 64;
  const int threads = cv::getNumThreads();
  return threads < 2 ? 1 : std::clamp(rows / kLeastRows, 1, 2 * threads);
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
