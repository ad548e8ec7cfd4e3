// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>

namespace all_in_focus::fuzz {

/// Numbers at which arithmetic goes wrong.
constexpr std::array<double, 15> kSpecialNumbers{0.0,
                                                 -0.0,
                                                 1.0,
                                                 -1.0,
                                                 0.5,
                                                 1e-9,
                                                 1e9,
                                                 -1e9,
                                                 1e38,
                                                 1e300,
                                                 -1e300,
                                                 std::numeric_limits<double>::denorm_min(),
                                                 std::numeric_limits<double>::infinity(),
                                                 -std::numeric_limits<double>::infinity(),
                                                 std::numeric_limits<double>::quiet_NaN()};

/// Reads values from the bytes of a fuzzer, one after the other; zeros when there are no more. Seed writes
/// them.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  bool isEmpty() const { return size_ == 0; }

  template <typename T>
  T take() {
    T value{};
    const std::size_t count = std::min(sizeof value, size_);
    if (count > 0) std::memcpy(&value, data_, count);
    skip(count);
    return value;
  }

  /// 0..count-1, from one byte.
  int below(int count) { return take<std::uint8_t>() % count; }

  bool flag() { return below(2) != 0; }

  /// One of kSpecialNumbers, a multiple of 1/64, or any double.
  double number() {
    const int kind = take<std::uint8_t>();
    if (kind < static_cast<int>(kSpecialNumbers.size())) return kSpecialNumbers[kind];
    return kind < 128 ? take<std::int32_t>() / 64.0 : take<double>();
  }

  /// Any bytes, up to `most` of them (255 at most).
  std::string text(std::size_t most = 255) {
    return bytes(std::min<std::size_t>(take<std::uint8_t>(), most));
  }

  std::string rest() { return bytes(size_); }

  /// Up to the first mark, which is left out; the rest if there is none.
  std::string numberUpTo(char mark) {
    const auto* const end = std::find(data_, data_ + size_, static_cast<std::uint8_t>(mark));
    const bool found = end != data_ + size_;
    std::string part = bytes(end - data_);
    if (found) skip(1);
    return part;
  }

 private:
  std::string bytes(std::size_t count) {
    count = std::min(count, size_);
    const auto* const begin = data_;
    skip(count);
    return {begin, begin + count};
  }
  void skip(std::size_t count) {
    data_ += count;
    size_ -= count;
  }

  const std::uint8_t* data_;
  std::size_t size_;
};

/// Writes what Input reads.
class Seed {
 public:
  template <typename T>
  Seed& put(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Seed& below(int value) { return put(static_cast<std::uint8_t>(value)); }
  Seed& flag(bool value) { return below(value ? 1 : 0); }
  Seed& number(double value) { return below(255).put(value); }
  Seed& text(const std::string& text) { return below(static_cast<int>(text.size())).rest(text); }
  Seed& rest(const std::string& bytes) {
    bytes_ += bytes;
    return *this;
  }

  operator std::string() const { return bytes_; }

 private:
  std::string bytes_;
};

}  // namespace all_in_focus::fuzz
