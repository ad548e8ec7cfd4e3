// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/focus_breathing.hpp"

#include <cmath>
#include <limits>

namespace all_in_focus::core {
namespace {

constexpr double kLargestBeta = 3;   // lenses are between -1 and 2
constexpr double kPriorBeta = 1;     // beta is 0, give or take this much, before anything is known
constexpr double kSignificance = 3;  // standard deviations; a lens that does not breathe has beta 0
constexpr double kLargestError = 4;  // mean square of the errors over their standard deviations

}  // namespace

double FocusBreathing::magnification(double focus_mm, double focal_length_mm) {
  const bool known = focal_length_mm > 0 && std::isfinite(focal_length_mm) && focus_mm > focal_length_mm;
  return known ? focal_length_mm / (focus_mm - focal_length_mm) : std::numeric_limits<double>::quiet_NaN();
}

void FocusBreathing::add(double from, double to, double scale, double deviation) {
  const double a = to - scale * from, y = scale - 1;
  const double weight = 1 / (deviation * deviation);
  if (!std::isfinite(a) || !std::isfinite(weight)) return;
  ++n_;
  aa_ += weight * a * a;
  ay_ += weight * a * y;
  yy_ += weight * y * y;
}

std::optional<double> FocusBreathing::beta() const {
  if (n_ == 0) return std::nullopt;
  const double beta = ay_ / (aa_ + 1 / (kPriorBeta * kPriorBeta));
  const double error = (yy_ - 2 * beta * ay_ + beta * beta * aa_) / n_;
  if (std::abs(beta) > kLargestBeta || error > kLargestError) return std::nullopt;
  // All frames may have been measured against the same one, and share its error.
  return beta * beta * aa_ > kSignificance * kSignificance * n_ ? beta : 0;
}

std::optional<double> FocusBreathing::scale(double from, double to) const {
  const std::optional<double> known = beta();
  if (!known || std::isnan(from + to)) return std::nullopt;
  return (1 + *known * to) / (1 + *known * from);
}

std::optional<double> FocusBreathing::b(double of_reference) const {
  const std::optional<double> known = beta();
  if (!known || std::isnan(of_reference)) return std::nullopt;
  return *known * (1 + of_reference) / (1 + *known * of_reference);
}

}  // namespace all_in_focus::core
