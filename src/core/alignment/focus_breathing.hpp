// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

namespace all_in_focus::core {

/// The magnification of a lens over its focus distance (focus breathing), by one number b:
///   m = 1 + b (v / v_ref - 1), v the image distance of the thin lens.
/// b = 1: the lens is moved as a whole; b = 0: it does not breathe. v / f - 1 is the thin lens's own
/// magnification x = f / (focus - f), image over object. Whatever the reference, m is proportional to 1 +
/// beta x, so a measured scale s from frame i to frame k gives a linear equation:
///   s (1 + beta x_i) = 1 + beta x_k  <=>  beta (x_k - s x_i) = s - 1.
class FocusBreathing {
 public:
  /// x at a focus distance, which may be infinite; NaN unless both lengths are known and focus > f > 0.
  static double magnification(double focus_mm, double focal_length_mm);

  /// A measured scale between two frames and its standard deviation, and their magnifications x. Ignored
  /// where one is unknown.
  void add(double from, double to, double scale, double deviation);

  /// Scale between two frames; nothing if a magnification is unknown, or nothing has been measured, or the
  /// model does not explain what has been measured.
  std::optional<double> scale(double from, double to) const;

  /// b relative to a reference frame, likewise.
  std::optional<double> b(double of_reference) const;

 private:
  std::optional<double> beta() const;

  int n_ = 0;
  double aa_ = 0, ay_ = 0, yy_ = 0;  ///< weighted sums, a = x_k - s x_i, y = s - 1
};

}  // namespace all_in_focus::core
