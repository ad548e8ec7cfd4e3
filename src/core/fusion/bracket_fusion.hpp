// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/fusion.hpp"
#include "fusion/refined_fusion.hpp"
#include "fusion/region_fusion.hpp"

namespace all_in_focus::core {

/// All-in-focus image of one bracket, frame by frame. Memory does not grow with the number of frames: the
/// mean or the chosen pixels are kept, not the frames. Not thread-safe; buffers are reused from bracket to
/// bracket.
///
/// Mode paper takes frames in any order. Mode refined takes the reference first, after observing what comes
/// before it in the bracket (see RefinedFusion).
class BracketFusion {
 public:
  /// Starts a bracket of frames of that size. The scene must be possible (Bracket checks it). Its images are
  /// shared, not copied; labels are scaled to the frames by nearest neighbour.
  void begin(const BracketScene& scene, const cv::Size& size, Mode mode, const RefinedConfig& config = {});

  /// Mode refined: sets or replaces the labels by which the result tells its regions.
  void setLabels(const cv::Mat& labels);

  /// Shows a frame that will be added later; call in the order of the bracket. Otherwise as add(). Does
  /// nothing in mode paper.
  void observe(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus);

  /// frame: CV_8U or CV_16U, three channels or four, of the bracket's size (else std::invalid_argument, and
  /// the bracket is as before). Pixels whose alpha is 0 weigh nothing. The first frame decides whether the
  /// result has 8 or 16 bits; evidence has 8. index: 0..65534, names the frame in the result. focus_mm: NaN =
  /// unknown, may be infinite. Returns why the frame does not fit the others and was left out, or "". A frame
  /// that was left out may be added once more: it may fit what has come since. may_wait: leaves out a frame,
  /// too, of which only later ones will tell.
  std::string add(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus, bool may_wait = false);

  /// Mode refined: why a frame that was observed or added does not fit another one, or "".
  std::string misfit(int index, int other) const;

  /// Mode refined: of the frames that were observed or added.
  FrameGroup largestGroup() const;

  /// Sets a function that receives each aligned frame from the next add() on, the reference first. add()
  /// calls it. Mode paper aligns no frames.
  void setAlignedFrameCallback(std::function<void(const AlignedFrame&)> callback);

  FusedBy fusedBy() const;

  /// The result of the frames so far; images are copies. Throws std::logic_error before the first frame.
  FusionResult result() const;
  /// See RefinedFusion.
  std::string hiddenDriftNote() const;

 private:
  void takeApart(const cv::Mat& frame, int index);

  BracketScene scene_;
  RefinedConfig config_;
  cv::Size size_;                 // of the frames
  std::vector<double> focus_mm_;  // of the frames used
  bool by_region_ = false;
  RegionFusion regions_;
  RefinedFusion refined_;
  cv::Mat labels_;                 // of the frames' size
  int depth_ = -1;                 // of the bracket; -1: no frame yet
  cv::Mat color_, opaque_, gray_;  // of the present frame; opaque_ is empty where all pixels are
};

}  // namespace all_in_focus::core
