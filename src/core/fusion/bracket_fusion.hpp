// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "alignment/bracket_alignment.hpp"
#include "alignment/relief.hpp"
#include "all_in_focus/fusion.hpp"
#include "fusion/defocus_prediction.hpp"
#include "fusion/exposure_matching.hpp"
#include "fusion/frame_groups.hpp"
#include "fusion/lens_check.hpp"
#include "fusion/noise_estimation.hpp"
#include "fusion/region_fusion.hpp"
#include "fusion/sharpness_pyramid.hpp"
#include "fusion/weighted_mean.hpp"

namespace all_in_focus::core {

/// All-in-focus image of one bracket, frame by frame. Memory does not grow with the number of frames: the
/// mean or the chosen pixels are kept, not the frames. The largest buffers are reused from bracket to
/// bracket. Not thread-safe.
///
/// Mode paper takes frames in any order, region by region (RegionFusion). Mode refined computes the mean of
/// all frames pixel by pixel, weighted by how sharp each frame is and by how sharp it should be by depth and
/// optics; see docs/algorithms.md. The first frame added is the reference: the result keeps its geometry and
/// exposure. Frames that come before it in the bracket are observed first, so that alignment can follow the
/// lens from neighbour to neighbour:
///   observe(0), .. observe(r), add(r), add(0), .. add(r - 1), add(r + 1), ...
class BracketFusion {
 public:
  /// Starts a bracket of frames of that size. Scene, frames and focus distances must be possible (Bracket
  /// checks them). The scene's images are shared, not copied; labels are scaled to the frames by nearest
  /// neighbour. drifts: the camera is known to move.
  void begin(const BracketScene& scene, const cv::Size& size, Mode mode, const RefinedConfig& config = {},
             bool drifts = false);

  /// Mode refined: sets or replaces the labels by which the result tells its regions.
  void setLabels(const cv::Mat& labels);

  /// Shows a frame that will be added later; call in the order of the bracket. Otherwise as add(). Does
  /// nothing in mode paper.
  void observe(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus);

  /// frame: CV_8U or CV_16U, three channels or four, of the bracket's size. Pixels whose alpha is 0 weigh
  /// nothing. The first frame decides whether the result has 8 or 16 bits; evidence has 8. index: 0..65534,
  /// names the frame in the result; once a bracket. focus_mm: NaN = unknown, may be infinite. Returns why the
  /// frame does not fit the others and was left out, or "". A frame that was left out may be added once more:
  /// it may fit what has come since. may_wait: leaves out a frame, too, of which only later ones will tell.
  std::string add(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus, bool may_wait = false);

  /// Mode refined: why a frame that was observed or added does not fit another one, or "".
  std::string misfit(int index, int other) const;

  /// Mode refined: of the frames that were observed or added.
  FrameGroup largestGroup() const;

  /// Sets a function that receives each aligned frame from the next add() on, the reference first. add()
  /// calls it. Mode paper aligns no frames.
  void setAlignedFrameCallback(std::function<void(const AlignedFrame&)> callback) {
    on_aligned_ = std::move(callback);
  }

  /// Whether neither labels nor depth count.
  bool bySharpnessAlone() const { return labels_.empty() && scene_.depth.empty(); }

  /// The result of the frames so far; images are copies. Throws std::logic_error before the first frame.
  FusionResult result() const;

  /// How far the camera has moved, for the user, where no depth is known, as far as the frames show it; "" if
  /// it has not. Takes some milliseconds.
  std::string hiddenDriftNote() const;
  /// Whether the camera moved, and depth corrects it.
  bool drifts() const { return alignment_.drifts(); }
  /// Whether depth would correct that if frames showed it.
  bool mayDrift() const { return !by_region_ && relief_.isKnown(); }

 private:
  void takeApart(const cv::Mat& frame);
  void beginRefined(bool drifts);
  void observeGray(int index, double focus_mm);
  std::string addRefined(int index, double focus_mm, bool may_wait);
  void setReference(int index);
  void compareWithEarlier();
  void checkLens();
  bool hasMoved(int index) const;
  std::function<bool(int)> fitting(int reference) const;
  AlignedFrame warped(AlignedFrame frame, const CameraMotion& motion);
  void noteDrift(const CameraMotion& motion);
  void addAligned(const AlignedFrame& frame, const cv::Mat& gray, bool resampled);

  BracketScene scene_;
  RefinedConfig config_;
  cv::Size size_;                 // of the frames
  std::vector<double> focus_mm_;  // of the frames used
  bool by_region_ = false;
  RegionFusion regions_;
  cv::Mat labels_;                 // of the frames' size
  int depth_ = -1;                 // of the bracket; -1: no frame yet
  cv::Mat color_, opaque_, gray_;  // of the present frame; opaque_ is empty where all pixels are

  cv::Point2d center_;
  double focal_length_mm_ = 0;  // 0 = unknown
  double focal_px_ = 0;         // 0 = unknown
  bool focus_known_ = false;    // of a frame that was observed
  bool predicts_ = false;
  LensCheck lens_;
  cv::Mat lights_;  // see SharpnessPyramid::Gauge
  struct HeldFrame {
    int index;
    cv::Mat gray;
  };
  std::deque<HeldFrame> held_;  // until the reference comes: the latest first
  NoiseSpectrum noise_;
  bool linear_ = false;     // codes are in proportion to light
  int reference_ = -1;      // index; -1: none yet
  bool resampled_ = false;  // frames are, as far as is known when the reference comes
  Relief relief_;
  cv::Mat1f relief_image_;            // empty until the first frame that needs it
  double moved_mm_ = 0, turned_ = 0;  // the greatest of all frames; radians
  cv::Mat reference_gray_;            // until a frame is measured against it
  BracketAlignment alignment_;
  FrameLight light_;
  ExposureMatching exposure_;
  SharpnessPyramid sharpness_;
  DefocusPrediction prediction_;
  WeightedMean mean_;
  std::function<void(const AlignedFrame&)> on_aligned_;
  cv::Mat1f squared_error_, wide_error_;  // on the grid of the prediction; with the frames' columns
};

}  // namespace all_in_focus::core
