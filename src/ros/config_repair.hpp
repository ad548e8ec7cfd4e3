// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <sstream>
#include <string>

namespace all_in_focus {

/// Puts the last good value in the place of each impossible one of a dynamic_reconfigure configuration.
/// dynamic_reconfigure clamps before it calls, so the ranges in cfg/ admit impossible values for this to see.
class ConfigRepair {
 public:
  template <typename T>
  void check(T& value, const T& good, bool possible, const char* name) {
    if (possible) return;
    warnings_ << (warnings_.tellp() > 0 ? ", " : "impossible configuration: ") << name << " = " << value
              << " (keeping " << good << ")";
    value = good;
  }

  /// One line for people, "" when nothing was repaired.
  std::string warnings() const { return warnings_.str(); }

  static bool isPositive(double value) { return std::isfinite(value) && value > 0; }
  static bool isNotNegative(double value) { return std::isfinite(value) && value >= 0; }

 private:
  std::ostringstream warnings_;
};

}  // namespace all_in_focus
