// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "optics/lens_fit.hpp"

namespace all_in_focus::core {

/// How much detail of the size of a pixel a frame shows, in cells of a few pixels.
struct DetailMap {
  cv::Mat1s cells;  ///< mean modulus of the Laplacian; empty: the frame is too small
  int cell = 1;     ///< px, their side

  static DetailMap of(const cv::Mat& gray);
};

/// In which frame of a list each tile of textured surface is sharpest that a sensor has measured the distance
/// of. That tells what the lens was focused on without any lens model: neither f-number nor focal length
/// counts.
class FocusVotes {
 public:
  /// A frame that has gone into votes.
  struct Frame {
    DetailMap detail;
    cv::Matx23d motion = cv::Matx23d::eye();  ///< from pixels of the reference to its own
    double gain = 1;                          ///< on its detail, that frames of another exposure are alike
  };

  /// frames: in the order of the list, over which the focus moves in one direction. depth: CV_16UC1 mm as
  /// measured, 0 = unknown, any size. size: of the frames.
  FocusVotes(const std::vector<Frame>& frames, const cv::Mat& depth, const cv::Size& size);

  /// How well the votes agree with a list, 0 to 1: a vote that is off by a whole step counts nothing.
  double support(const std::vector<FrameBlur>& list) const;

  /// What is wrong with a list: nothing, where the votes agree with it. None: they do not tell.
  std::optional<FocusCorrection> correctionOf(const std::vector<FrameBlur>& list) const;

  /// A list for frames of which none is known: inverse focus distances of a lens that moves in even steps,
  /// beyond infinity too. steps: of the lens at each frame, ascending. Empty: the votes do not tell.
  std::vector<double> focusAt(const std::vector<double>& steps) const;

 private:
  struct Vote {
    float from, to;  ///< places in the list, between frames: from there to there it is sharp
    float inverse_depth;

    double at(const std::vector<FrameBlur>& list) const;  ///< the middle: inverse focus distance
  };
  bool areReversed(const std::vector<FrameBlur>& list) const;
  double bestFactor(const std::vector<FrameBlur>& list) const;

  std::vector<Vote> votes_;
};

}  // namespace all_in_focus::core
