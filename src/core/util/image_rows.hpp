// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace all_in_focus::core {

/// Writes each of n values three times: one for each channel of a pixel.
void threeTimes(const std::int16_t* values, int n, std::int16_t* out);

/// Holds the last rows of an image that is computed row by row, from top to bottom: row y lies in line y
/// modulo the number of lines. Rows are numbered 0..height-1.
template <typename Value>
class LineBuffer {
 public:
  /// Forgets all rows. Keeps the memory.
  void begin(int lines, int width) {
    width_ = static_cast<size_t>(width);
    pixels_.resize(lines * width_);
    y_of_line_.assign(lines, -1);
  }

  /// Returns row y. If it is not in the buffer, calls compute(y, out), which writes `width` values to out.
  /// The pointer is valid until another row takes the line.
  template <typename Compute>
  const Value* row(int y, const Compute& compute) {
    const size_t line = static_cast<size_t>(y) % y_of_line_.size();
    Value* out = &pixels_[line * width_];
    if (y_of_line_[line] != y) compute(y, out);
    y_of_line_[line] = y;
    return out;
  }

 private:
  size_t width_ = 0;
  std::vector<Value> pixels_;
  std::vector<int> y_of_line_;  ///< -1: empty
};

}  // namespace all_in_focus::core
