// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <set>
#include <vector>

namespace all_in_focus::core {

/// The longest shift that is no jump, and changes the light of no block: of half the diagonal.
constexpr double kSmallShift = 0.015;

/// The light of frames, to tell those that are much darker or brighter than others. Of each frame it keeps
/// 300 numbers at most.
class FrameLight {
 public:
  void clear() { blocks_.clear(); }

  /// gray: CV_8UC1.
  void observe(const cv::Mat& gray, int index);

  /// Light of one observed frame over that of another, in linear light (sRGB): the median over blocks, so
  /// that neither a hand in the picture nor the blur of a lamp changes it.
  double ratio(int index, int reference) const;

  /// The same, but 1 where the light between has changed by no more than `most` from frame to frame: exposure
  /// that drifts is no fault of a frame.
  double jump(int index, int reference, double most) const;

  /// Share of the picture in which the light of two frames differs by more than a quarter from that ratio.
  double changed(int index, int other) const;

  /// Share of the picture that something hides which passed by: in that frame and in two more at most, while
  /// most frames next to it, before and behind, show the same without it. 0: nothing does, or the frames that
  /// tell have not been observed. Frames of another light, and those that do not count, are passed over.
  double intrusion(int index, const std::function<bool(int)>& counts) const;

  /// Whether the newest frame differs from most before it: later ones may show that something passes by.
  bool isSudden(int index, const std::function<bool(int)>& counts) const;

  /// The frames observed, by index.
  const std::map<int, cv::Mat>& frames() const { return blocks_; }

 private:
  struct Neighbours {
    std::vector<int> before, behind;  // the nearest first
    double usual = 0;                 // share of the picture that changes from frame to frame
    int differing = 0, alike = 0;     // how many differ from the frame; how many do not, with itself
  };

  Neighbours neighbours(int index, const std::function<bool(int)>& counts) const;
  bool differs(int index, int other, double usual) const;

  std::map<int, cv::Mat> blocks_;  // logarithms of their light
};

/// The largest group of frames that were taken alike.
struct FrameGroup {
  std::set<int> others;  ///< the frames that do not belong to it
  int lead = 0;          ///< how many frames more than the next largest group has
};

/// Groups frames. Two that follow each other in a group show the same, in the same light, from the same
/// place. A bracket may drift: a step counts as a jump where it is much longer than most.
///
/// displacement(index, earlier): px between two frames, negative where they show different things.
/// radius: half the diagonal, px.
FrameGroup largestGroup(const FrameLight& light, const std::function<double(int, int)>& displacement,
                        double radius);

}  // namespace all_in_focus::core
