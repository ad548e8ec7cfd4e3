// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <optional>
#include <string>

namespace all_in_focus {

/// A colour frame and its message from rgb/focus, if there is one.
struct BracketFrame {
  sensor_msgs::ImageConstPtr image;
  FocusFrameConstPtr focus;
};

struct BracketConfig {
  int size = 0;      ///< frames of a bracket without FocusFrame, 0 = unknown
  double gap_s = 1;  ///< without FocusFrame a longer gap, either way, ends a bracket; 0 = never
};

/// Finds where a focus bracket begins and ends, and the index of each frame: from FocusFrame messages where
/// there are some, else from the number of frames and from gaps in time.
class BracketAssembler {
 public:
  /// What to do with a frame.
  struct Step {
    bool begin = false;  ///< a bracket begins with it
    bool use = false;    ///< false: it belongs to no bracket, `reason` says why
    std::string reason;
    FocusFrame frame;  ///< which frame of which bracket it is; last: the bracket has ended with it
    int missing = 0;   ///< frames of the bracket that did not come so far; all of them, if it is the last
  };

  explicit BracketAssembler(const BracketConfig& config = {}) : config_(config) {}
  void configure(const BracketConfig& config) { config_ = config; }

  /// Takes note of a bracket of which FocusFrame 0 has come: it is used even where that first picture is
  /// lost.
  void announce(std::uint32_t bracket_id) { announced_ = bracket_id; }

  /// The frame belongs to another bracket than the open one, which ended without notice: close() it before
  /// add().
  bool endsBefore(const BracketFrame& frame) const;

  Step add(const BracketFrame& frame);

  /// Ends the open bracket. Returns how many of its frames, as far as they were announced, did not come.
  int close();
  /// Forgets all frames, as after the start: a bracket whose first frame was not seen is left out.
  void restart() { *this = BracketAssembler(config_); }

  /// Whether a pause of that length ends the open bracket.
  bool endsAfter(double pause_s) const;

  bool open() const { return open_; }
  bool byFocus() const { return by_focus_; }  ///< FocusFrame messages define the open bracket
  std::uint32_t id() const { return id_; }    ///< of the open bracket

 private:
  std::string whyRefused(const BracketFrame& frame) const;  // "" = it is not
  /// Whether a frame from the middle of a bracket is the first one with a FocusFrame, since the start or
  /// since frames without one.
  bool hasBegunUnseen(std::uint32_t bracket_id) const {
    return !by_focus_ && !skipped_ && announced_ != bracket_id;
  }

  BracketConfig config_;
  bool open_ = false;
  bool by_focus_ = false;          ///< the open bracket, or the last one
  std::uint32_t id_ = UINT32_MAX;  ///< of the open bracket, or the last one; 0 follows
  std::uint32_t next_ = 0;         ///< index expected next
  std::uint32_t count_ = 0;
  int missing_ = 0;
  ros::Time last_stamp_;
  std::optional<std::uint32_t> announced_;  ///< the last bracket
  std::optional<std::uint32_t> skipped_;    ///< the bracket that is left out: its first frame was not seen
};

}  // namespace all_in_focus
