// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/focus_breathing.hpp"

#include <cmath>
#include <limits>

namespace all_in_focus::core {
namespace {

constexpr double kLargestBeta = 3;    // lenses are between -1 and 2
constexpr double kPriorBeta = 1;      // beta is 0, give or take this much, before anything is known
constexpr double kLargestMisfit = 4;  // mean square of the errors over their standard deviations

}  // namespace

double FocusBreathing::extension(double focus_mm, double focal_length_mm) {
  const bool known = focal_length_mm > 0 && std::isfinite(focal_length_mm) && focus_mm > focal_length_mm;
  return known ? focal_length_mm / (focus_mm - focal_length_mm) : std::numeric_limits<double>::quiet_NaN();
}

void FocusBreathing::add(double extension_from, double extension_to, double scale, double deviation) {
  const double a = extension_to - scale * extension_from, y = scale - 1;
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
  const double misfit = (yy_ - 2 * beta * ay_ + beta * beta * aa_) / n_;
  if (std::abs(beta) > kLargestBeta || misfit > kLargestMisfit) return std::nullopt;
  return beta;
}

std::optional<double> FocusBreathing::scale(double extension_from, double extension_to) const {
  const std::optional<double> known = beta();
  if (!known || std::isnan(extension_from + extension_to)) return std::nullopt;
  return (1 + *known * extension_to) / (1 + *known * extension_from);
}

std::optional<double> FocusBreathing::b(double extension_of_reference) const {
  const std::optional<double> known = beta();
  if (!known || std::isnan(extension_of_reference)) return std::nullopt;
  return *known * (1 + extension_of_reference) / (1 + *known * extension_of_reference);
}

}  // namespace all_in_focus::core
