// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/frame_order.hpp"

#include <algorithm>
#include <cstdlib>

namespace all_in_focus::core {

FrameOrder::FrameOrder(Mode mode, int reference)
    : reference_first_(mode != Mode::kPaper), reference_(reference), holding_(reference_first_) {}

void FrameOrder::arrived(int index, bool last) {
  waiting_.insert(index);
  if (last || index >= reference_) holding_ = false;
}

std::optional<int> FrameOrder::next() const {
  if (holding_ || waiting_.empty()) return std::nullopt;
  if (!reference_first_ || any_used_) return *waiting_.begin();
  return *std::min_element(waiting_.begin(), waiting_.end(), [this](int a, int b) {
    return std::abs(a - reference_) < std::abs(b - reference_);  // of two as near the first one
  });
}

void FrameOrder::done(int index, bool used) {
  waiting_.erase(index);
  any_used_ = any_used_ || used;
}

}  // namespace all_in_focus::core
