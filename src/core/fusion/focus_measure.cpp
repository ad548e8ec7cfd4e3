// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/focus_measure.hpp"

namespace all_in_focus::core {
double normalizedVariance(const GraySums& sums) {
  if (sums.n == 0 || sums.sum == 0) return 0;
  // n mu = S. With S = q n + r, sum (I - mu)^2 = sum (I - q)^2 - r^2 / n: exact integers, so that a flat
  // region gives 0.
  const std::uint64_t q = sums.sum / sums.n, r = sums.sum % sums.n;
  const double about_q = static_cast<double>(sums.sum_of_squares + q * q * sums.n - 2 * q * sums.sum);
  const double remainder = static_cast<double>(r);
  return (about_q - remainder * remainder / static_cast<double>(sums.n)) / static_cast<double>(sums.sum);
}

}  // namespace all_in_focus::core
