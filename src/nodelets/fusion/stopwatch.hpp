// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>

namespace all_in_focus {

/// Wall time since it was made.
class Stopwatch {
 public:
  using Clock = std::chrono::steady_clock;

  double milliseconds() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }

 private:
  Clock::time_point start_ = Clock::now();
};

}  // namespace all_in_focus
