// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <set>
#include <sstream>
#include <string>

namespace all_in_focus {

/// Replaces each impossible value of a dynamic_reconfigure configuration by the last good one.
/// dynamic_reconfigure clamps values to the ranges in cfg/ before this sees them. So these ranges include
/// impossible values: otherwise a wrong value would silently become another one.
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
  /// A number that must be finite, and 0 or more.
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
