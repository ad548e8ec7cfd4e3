// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <set>

#include "all_in_focus/bracket_fusion.hpp"

namespace all_in_focus::core {

/// The order in which the frames of a bracket are fused. Files and nodes both follow it, so both give the
/// same pixels.
///
/// Mode paper fuses frames as they arrive. Mode refined fuses the reference first, then the frames before it,
/// then those behind it, because geometry and exposure of the result are those of the reference. Frames that
/// arrive before the reference are therefore observed (BracketFusion::observe), and fused when it is there.
///
/// For each frame: arrived(); observe it if isHolding(); then fuse what next() names and report it with
/// done(), until next() names none.
class FrameOrder {
 public:
  /// reference: index of the reference frame, >= 0.
  FrameOrder(Mode mode, int reference);

  /// Call when a frame has arrived, in ascending order of index. `last`: no frame follows it.
  void arrived(int index, bool last = false);

  /// Call when no frame follows. If the reference never came, the frame nearest to it becomes the reference.
  void close() { holding_ = false; }

  /// Whether frames wait for the reference.
  bool isHolding() const { return holding_; }

  /// Index of the frame to be fused now, if any.
  std::optional<int> next() const;

  /// Call when the frame was fused, or left out (`used` false); also when a frame is refused while it is
  /// held.
  void done(int index, bool used);

 private:
  bool reference_first_;
  int reference_;
  bool holding_;
  bool any_used_ = false;
  std::set<int> waiting_;
};

}  // namespace all_in_focus::core
