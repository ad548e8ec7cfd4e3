// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <set>
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

  void checkOneOf(std::string& value, const std::string& good, const std::set<std::string>& choices,
                  const char* name) {
    check(value, good, choices.count(value) > 0, name);
  }
  /// A number that is to be 0 or more, and finite.
  template <typename T>
  void checkNotNegative(T& value, const T& good, const char* name) {
    check(value, good, std::isfinite(value) && value >= 0, name);
  }

  /// One line for people, "" when nothing was repaired.
  std::string warnings() const { return warnings_.str(); }

 private:
  std::ostringstream warnings_;
};

}  // namespace all_in_focus
