// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "natural_order.hpp"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <regex>

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

std::string withoutZeros(const std::string& digits) {
  return digits.substr(std::min(digits.find_first_not_of('0'), digits.size()));
}

std::string lowerCase(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

int sign(std::size_t a, std::size_t b) {
  return a < b ? -1 : a > b ? 1 : 0;
}

// Digits of any length, or with a point or comma.
int compareNumbers(const std::string& a, const std::string& b) {
  const std::size_t point_a = a.find_first_of(".,"), point_b = b.find_first_of(".,");
  const std::string left = withoutZeros(a.substr(0, point_a)), right = withoutZeros(b.substr(0, point_b));
  if (const int by_length = sign(left.size(), right.size()); by_length != 0) return by_length;
  if (const int by_digits = left.compare(right); by_digits != 0) return by_digits;
  const auto fraction = [](const std::string& number, std::size_t point) {
    return point == std::string::npos ? std::string() : number.substr(point + 1);
  };
  return fraction(a, point_a).compare(fraction(b, point_b));
}

// The mark before a number that may be its sign.
char mark(const std::string& text) {
  return !text.empty() && (text.back() == '-' || text.back() == '+') ? text.back() : ' ';
}

std::string withoutMark(const std::string& text) {
  return mark(text) == ' ' ? text : text.substr(0, text.size() - 1);
}

// What stands behind the point of a decimal is no ending.
std::string withoutEnding(const std::string& name) {
  const fs::path path(name);
  const std::string ending = path.extension().string();
  return ending.size() > 1 && std::isalpha(static_cast<unsigned char>(ending[1])) != 0 ? path.stem().string()
                                                                                       : name;
}

bool hasDecimals(const std::vector<std::string>& names) {
  static const std::regex chain("[0-9]+([.,][0-9]+){2,}"), decimal("[0-9]+[.,]([0-9]+)");
  std::set<std::size_t> lengths;
  bool counts = false;  // a fraction ends in 0
  for (const std::string& name : names) {
    const std::string stem = withoutEnding(name);
    if (std::regex_search(stem, chain)) return false;
    for (std::sregex_iterator it(stem.begin(), stem.end(), decimal), end; it != end; ++it) {
      const std::string fraction = (*it)[1];
      lengths.insert(fraction.size());
      counts |= fraction.size() > 1 && fraction.back() == '0';
    }
  }
  return lengths.size() == 1 || (!lengths.empty() && !counts);
}

}  // namespace

NaturalOrder::NaturalOrder(const std::vector<std::string>& names) {
  const bool decimals = hasDecimals(names);
  std::map<std::pair<std::string, std::size_t>, std::set<char>> marks;
  for (const std::string& name : names) {
    const Parts& parts = names_[name] = split(name, decimals);
    for (std::size_t i = 0; i < parts.numbers.size(); ++i)
      marks[{withoutMark(parts.text[i]), i}].insert(mark(parts.text[i]));
  }
  for (const auto& [place, before] : marks) {
    if (before.count('-') != 0 && before.size() > 1) signed_.insert(place);
  }
}

NaturalOrder::Parts NaturalOrder::split(const std::string& given, bool decimals) {
  static const std::regex whole("[0-9]+"), with_decimals("[0-9]+([.,][0-9]+)?");
  const std::string name = lowerCase(given);
  Parts parts;
  const std::string stem = withoutEnding(name);
  parts.ending = name.substr(stem.size());
  auto begin = stem.cbegin();
  for (std::sregex_iterator it(stem.begin(), stem.end(), decimals ? with_decimals : whole), end; it != end;
       ++it) {
    parts.text.emplace_back(begin, (*it)[0].first);
    parts.numbers.push_back(it->str());
    begin = (*it)[0].second;
  }
  parts.text.emplace_back(begin, stem.cend());
  return parts;
}

bool NaturalOrder::isSigned(const Parts& name, std::size_t number) const {
  return signed_.count({withoutMark(name.text[number]), number}) != 0;
}

std::string NaturalOrder::textBefore(const Parts& name, std::size_t number) const {
  const std::string& text = name.text[number];
  return number < name.numbers.size() && isSigned(name, number) ? withoutMark(text) : text;
}

int NaturalOrder::compare(const std::string& a, const std::string& b) const {
  const Parts &left = names_.at(a), &right = names_.at(b);
  const std::size_t numbers = std::min(left.numbers.size(), right.numbers.size());
  for (std::size_t i = 0; i < numbers; ++i) {
    if (const int by_text = textBefore(left, i).compare(textBefore(right, i)); by_text != 0) return by_text;
    const bool minus_left = isSigned(left, i) && mark(left.text[i]) == '-';
    const bool minus_right = isSigned(right, i) && mark(right.text[i]) == '-';
    if (minus_left != minus_right) return minus_left ? -1 : 1;
    if (const int number = compareNumbers(left.numbers[i], right.numbers[i]); number != 0)
      return minus_left ? -number : number;
  }
  if (const int by_text = textBefore(left, numbers).compare(textBefore(right, numbers)); by_text != 0)
    return by_text;
  if (const int by_count = sign(left.numbers.size(), right.numbers.size()); by_count != 0) return by_count;
  return left.ending.compare(right.ending);
}

std::vector<std::string> inNaturalOrder(const std::vector<std::string>& paths) {
  const auto nameOf = [](const std::string& path) { return fs::path(path).filename().string(); };
  std::vector<std::string> names, sorted = paths;
  std::transform(paths.begin(), paths.end(), std::back_inserter(names), nameOf);
  const NaturalOrder order(names);
  std::sort(sorted.begin(), sorted.end(), [&](const std::string& a, const std::string& b) {
    const int by_name = order.compare(nameOf(a), nameOf(b));
    return by_name != 0 ? by_name < 0 : a < b;
  });
  return sorted;
}

std::size_t firstAfterRollOver(const std::vector<std::string>& names) {
  constexpr std::size_t kFewestDigits = 4, kMostDigits = 9;  // of all makers; of what stol() takes
  static const std::regex number("[0-9]+");
  std::vector<std::vector<std::string>> numbers;
  std::set<std::string> without_numbers;
  for (const std::string& name : names) {
    numbers.emplace_back(std::sregex_token_iterator(name.begin(), name.end(), number),
                         std::sregex_token_iterator());
    without_numbers.insert(std::regex_replace(lowerCase(name), number, "0"));
  }
  if (without_numbers.size() != 1) return 0;
  std::set<std::size_t> differing;
  for (const auto& of_name : numbers) {
    for (std::size_t i = 0; i < of_name.size(); ++i) {
      if (of_name[i] != numbers.front()[i]) differing.insert(i);
    }
  }
  if (differing.size() != 1) return 0;
  const std::size_t counter = *differing.begin(), digits = numbers.front()[counter].size();
  if (digits < kFewestDigits || digits > kMostDigits) return 0;
  std::vector<std::int64_t> values;
  for (const auto& of_name : numbers) {
    if (of_name[counter].size() != digits) return 0;
    values.push_back(std::stol(of_name[counter]));
  }
  // Some makers count to 9999 with five digits.
  std::int64_t round = 10000;
  while (round <= values.back()) round *= 10;
  // Whoever numbers by hand leaves no gap of half the counter. Distances may, but are not close together
  // else.
  constexpr std::int64_t kUsualStep = 10;  // at most: some frames of a series may have been deleted
  for (std::size_t i = 1; i < values.size(); ++i) {
    const std::int64_t all = round - values[i] + values[i - 1];
    if (values[i] - values[i - 1] > round / 2)
      return all <= kUsualStep * static_cast<std::int64_t>(values.size()) ? i : 0;
  }
  return 0;
}

}  // namespace all_in_focus
