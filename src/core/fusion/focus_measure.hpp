// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace all_in_focus::core {

/// Sums over the gray pixels of one region in one frame.
struct GraySums {
  std::uint64_t n = 0;
  std::uint64_t sum = 0;
  std::uint64_t sum_of_squares = 0;
};

/// Focus measure of a region: NV = 1 / (n mu) * sum (I - mu)^2, mu the mean gray value. 0 for an empty or
/// black one.
double normalizedVariance(const GraySums& sums);

}  // namespace all_in_focus::core
