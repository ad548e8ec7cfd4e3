// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bracket_assembler.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

constexpr std::uint32_t kMaxFrames = 65535;  // 65535 itself means "none" in a source index

}  // namespace

bool BracketAssembler::endsBefore(const BracketFrame& frame) const {
  if (!open_ || !whyRefused(frame).empty()) return false;
  if (by_focus_ != (frame.focus != nullptr)) return true;
  // A bracket number that begins again at index 0 is a new bracket: the bag loops, or the driver was
  // restarted.
  if (frame.focus) return frame.focus->bracket_id != id_ || frame.focus->index == 0;
  return endsAfter(std::abs(secondsBetween(last_stamp_, frame.image->header.stamp)));
}

std::string BracketAssembler::whyRefused(const BracketFrame& frame) const {
  if (!frame.focus) return "";
  const std::uint32_t id = frame.focus->bracket_id, index = frame.focus->index;
  const std::string bracket = "bracket " + std::to_string(id);
  const bool same = by_focus_ && id == id_;
  if (index >= kMaxFrames) return bracket + ": frame index " + std::to_string(index) + " is above 65534";
  if (index == 0) return "";  // the first frame of a bracket is always accepted
  if (hasBegunUnseen(id) || skipped_ == id)
    return bracket + " had begun before anybody listened: waiting for the next one";
  if (open_ && same && index < next_)
    return bracket + ": frame " + std::to_string(index) + " came twice or too late";
  return !open_ && same ? bracket + " is finished already" : "";
}

BracketAssembler::Step BracketAssembler::add(const BracketFrame& frame) {
  const FocusFrame* focus = frame.focus.get();
  Step step;
  step.frame.header = frame.image->header;
  step.reason = whyRefused(frame);
  step.use = step.reason.empty();
  if (!step.use) {
    if (hasBegunUnseen(focus->bracket_id)) skipped_ = focus->bracket_id;
    return step;
  }
  step.begin = !open_;
  if (step.begin) {
    id_ = focus ? focus->bracket_id : id_ + 1;
    next_ = 0;
    missing_ = 0;
  }
  const std::uint32_t index = focus ? focus->index : next_;
  open_ = true;
  by_focus_ = focus != nullptr;
  skipped_.reset();
  count_ = focus ? std::min(focus->count, kMaxFrames) : static_cast<std::uint32_t>(config_.size);
  missing_ += static_cast<int>(index - next_);
  next_ = index + 1;
  last_stamp_ = frame.image->header.stamp;
  step.frame.bracket_id = id_;
  step.frame.index = index;
  step.frame.count = count_;
  step.frame.last = (focus && focus->last) || next_ == kMaxFrames || (count_ > 0 && next_ >= count_);
  step.frame.focus_distance = focus ? focus->focus_distance : std::numeric_limits<double>::quiet_NaN();
  if (step.frame.last) close();
  step.missing = missing_;
  return step;
}

int BracketAssembler::close() {
  if (open_ && by_focus_ && count_ > next_) missing_ += static_cast<int>(count_ - next_);
  open_ = false;
  return missing_;
}

bool BracketAssembler::endsAfter(double pause_s) const {
  return open_ && !by_focus_ && config_.gap_s > 0 && pause_s > config_.gap_s;
}

}  // namespace all_in_focus
