// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bracket_assembler.hpp"

#include <algorithm>
#include <cmath>

namespace all_in_focus {
namespace {

constexpr std::uint32_t kMaxFrames = 65535;  // 65535 itself means "none" in a source index

std::string text(std::uint32_t number) {
  return std::to_string(number);
}

}  // namespace

bool BracketAssembler::announce(std::uint32_t bracket_id, std::uint32_t index) {
  const bool begins = index == 0 || announced_ != bracket_id;
  announced_ = bracket_id;
  if (index == 0) whole_ = bracket_id;
  return begins;
}

bool BracketAssembler::endsBefore(const FrameInfo& frame) const {
  std::string reason;
  if (!open_ || refuses(frame, reason)) return false;
  if (frame.has_focus != by_focus_) return true;
  // A bracket number that begins again at index 0 is a new bracket: the bag loops, or the driver was
  // restarted.
  if (frame.has_focus) return frame.bracket_id != id_ || frame.index == 0;
  return config_.gap_s > 0 && std::abs(frame.stamp_s - last_stamp_s_) > config_.gap_s;
}

bool BracketAssembler::refuses(const FrameInfo& frame, std::string& reason) const {
  if (!frame.has_focus) return false;
  const std::string bracket = "bracket " + text(frame.bracket_id);
  const bool same = by_focus_ && frame.bracket_id == id_ && !fresh_;
  if (frame.index >= kMaxFrames) {
    reason = bracket + ": frame index " + text(frame.index) + " is above 65534";
  } else if (frame.index == 0) {
    return false;  // the first frame of a bracket is always accepted
  } else if (hasBegunUnseen(frame.bracket_id) || (skipping_ && frame.bracket_id == skip_id_)) {
    reason = bracket + " had begun before anybody listened: waiting for the next one";
  } else if (open_ && same && frame.index < next_) {
    reason = bracket + ": frame " + text(frame.index) + " came twice or too late";
  } else if (!open_ && same) {
    reason = bracket + " is finished already";
  }
  return !reason.empty();
}

BracketAssembler::Step BracketAssembler::add(const FrameInfo& frame) {
  Step step;
  if (refuses(frame, step.reason)) {
    if (hasBegunUnseen(frame.bracket_id)) {
      skipping_ = true;
      skip_id_ = frame.bracket_id;
    } else if (skipping_ && frame.bracket_id == skip_id_) {
      step.reason.clear();  // said once a bracket
    }
    fresh_ = false;
    return step;
  }
  step.use = true;
  step.begin = !open_;
  if (step.begin) {
    id_ = frame.has_focus ? frame.bracket_id : fresh_ ? 0 : id_ + 1;
    next_ = 0;
    missing_ = 0;
  }
  const std::uint32_t index = frame.has_focus ? frame.index : next_;
  open_ = true;
  by_focus_ = frame.has_focus;
  fresh_ = skipping_ = false;
  count_ = frame.has_focus ? std::min(frame.count, kMaxFrames) : static_cast<std::uint32_t>(config_.size);
  missing_ += static_cast<int>(index - next_);
  next_ = index + 1;
  last_stamp_s_ = frame.stamp_s;
  step.index = static_cast<int>(index);
  step.bracket_id = id_;
  step.length = static_cast<int>(count_);
  step.last = (frame.has_focus && frame.last) || next_ == kMaxFrames || (count_ > 0 && next_ >= count_);
  if (step.last) close();
  step.missing = missing_;
  return step;
}

void BracketAssembler::close() {
  if (open_ && by_focus_ && count_ > next_) missing_ += static_cast<int>(count_ - next_);
  open_ = false;
}

void BracketAssembler::restart() {
  open_ = false;
  fresh_ = true;
  skipping_ = false;
  announced_ = whole_ = std::nullopt;
}

bool BracketAssembler::gapElapsed(double now_s) const {
  return open_ && !by_focus_ && config_.gap_s > 0 && now_s - last_stamp_s_ > config_.gap_s;
}

}  // namespace all_in_focus
