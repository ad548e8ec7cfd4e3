// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace all_in_focus {

/// The order of file names as people number them. Numbers in names count as numbers, of any length, with
/// their signs and decimals; upper and lower case are alike; endings decide last.
///
/// What a mark before or within digits means is seen in all names together. A minus is a sign where names
/// that are else alike have a plus or nothing: "z-2, z0, z2", but "shot-2" has a hyphen. One point or comma
/// between two numbers is that of a decimal ("0.5m, 1m, 2.25m"), except in dates and versions, where three
/// numbers hang together, and where a counter shows by its 10 or 20: "1.9, 1.10".
class NaturalOrder {
 public:
  /// names: of files, without folders; all that will be compared.
  explicit NaturalOrder(const std::vector<std::string>& names);

  /// Below, at or above 0 as a comes before, beside or behind b. Both are of those names.
  int compare(const std::string& a, const std::string& b) const;

 private:
  // "img (10).PNG" is "img (", 10, ")", ".png".
  struct Parts {
    std::vector<std::string> text;     // in lower case; before, between and behind the numbers
    std::vector<std::string> numbers;  // digits, with decimals where the names have them
    std::string ending;
  };

  static Parts split(const std::string& given, bool decimals);
  bool isSigned(const Parts& name, std::size_t number) const;
  std::string textBefore(const Parts& name, std::size_t number) const;  // without its sign

  std::map<std::string, Parts> names_;
  std::set<std::pair<std::string, std::size_t>> signed_;  // text before the sign, which number of the name
};

/// Paths in the order of their file names.
std::vector<std::string> inNaturalOrder(const std::vector<std::string>& paths);

/// Where sorted names begin in time: behind the place at which a camera's counter began anew (9999, then 0000
/// or 0001). 0 where it did not. The counter is the one number that differs; it is padded to at least four
/// digits.
std::size_t firstAfterRollOver(const std::vector<std::string>& names);

}  // namespace all_in_focus
