// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "alignment/bracket_alignment.hpp"
#include "alignment/reference_warp.hpp"
#include "all_in_focus/fusion.hpp"
#include "fusion/border_fade.hpp"
#include "fusion/brightness_penalty.hpp"
#include "fusion/defocus_prediction.hpp"
#include "fusion/exposure_matching.hpp"
#include "fusion/frame_groups.hpp"
#include "fusion/lens_check.hpp"
#include "fusion/noise_estimation.hpp"
#include "fusion/sharpness_pyramid.hpp"
#include "fusion/weighted_mean.hpp"

namespace all_in_focus::core {

/// Computes the mean of all frames pixel by pixel, weighted by how sharp each frame is and by how sharp it
/// should be by depth and optics. See docs/algorithms.md.
///
/// The first frame added is the reference: the result keeps its geometry and exposure. Frames that come
/// before it in the bracket are observed first, so that alignment can follow the lens from neighbour to
/// neighbour:
///   observe(0), .. observe(r), add(r), add(0), .. add(r - 1), add(r + 1), ...
class RefinedFusion {
 public:
  /// The scene's images are shared, not copied. size: of the frames. Throws std::invalid_argument.
  void begin(const BracketScene& scene, const RefinedConfig& config, const cv::Size& size);

  /// gray: CV_8UC1; index: ascending; focus_mm: NaN = unknown, may be infinite.
  void observe(const cv::Mat& gray, int index, double focus_mm);

  /// frame: CV_8UC3, or CV_16UC3 in all calls; gray: CV_8UC1 of it; opaque: CV_8UC1, 0 where pixels weigh
  /// nothing; empty: nowhere. Observes the frame unless it has been. Returns why the frame does
  /// not fit the reference, which leaves it out, or "". A frame that was left out may be added once more: it
  /// may fit what has come since. may_wait: leaves out a frame, too, of which only later ones will tell.
  std::string add(const cv::Mat& frame, const cv::Mat& gray, int index, double focus_mm,
                  const cv::Mat& opaque = {}, bool may_wait = false);

  /// Why an observed frame does not fit another one, or "".
  std::string misfit(int index, int reference) const;

  /// Of the frames observed so far.
  FrameGroup largestGroup() const;

  /// See BracketFusion.
  void setAlignedFrameCallback(std::function<void(const AlignedFrame&)> callback) {
    on_aligned_ = std::move(callback);
  }

  /// What the frames say against focus distances and f-number, a line each; what the prediction does about it
  /// is done already.
  const std::vector<std::string>& lensNotes() const { return lens_.notes(); }

  /// How far the camera has moved, for the user; "" if it has not.
  std::string driftNote() const;
  /// The same where no depth is known, as far as the frames show it. Takes some milliseconds.
  std::string hiddenDriftNote() const;

  cv::Mat image() const { return mean_.image(); }
  const cv::Mat& sourceIndex() const { return mean_.sourceIndex(); }
  cv::Mat confidence() const { return mean_.confidence(); }

 private:
  AlignedFrame warped(AlignedFrame frame, const CameraMotion& motion);
  void noteDrift(const CameraMotion& motion);
  void addAligned(const AlignedFrame& frame, const cv::Mat& gray, bool resampled);

  struct HeldFrame {
    int index;
    cv::Mat gray;
  };
  bool hasMoved(int index) const;
  std::function<bool(int)> fitting(int reference) const;
  void compareWithEarlier(const cv::Mat& reference);

  void checkLens();

  RefinedConfig config_;
  cv::Size size_;
  cv::Point2d center_;
  double focal_length_mm_ = 0;  // 0 = unknown
  bool focus_known_ = false;    // of a frame that was observed
  bool predicts_ = false;
  LensCheck lens_;
  cv::Mat predicted_, lights_;   // CV_8UC1, see SharpnessPyramid::Gauge
  std::vector<HeldFrame> held_;  // until the reference comes: the latest first, the first frame last
  NoiseSpectrum noise_;
  bool linear_ = false;  // codes are in proportion to light
  int reference_ = -1;   // index; -1: none yet
  Relief relief_;
  cv::Mat1f relief_image_;            // empty until the first frame that needs it
  double focal_px_ = 0;               // 0 = unknown
  double moved_mm_ = 0, turned_ = 0;  // the greatest of all frames; radians
  cv::Mat reference_gray_;            // until a frame is measured against it; only where relief is known
  BracketAlignment alignment_;
  FrameLight light_;
  ReferenceWarp warp_;
  ExposureMatching exposure_;
  SharpnessPyramid sharpness_;
  BrightnessPenalty brightness_;
  BorderFade fade_;
  DefocusPrediction prediction_;
  WeightedMean mean_;
  std::function<void(const AlignedFrame&)> on_aligned_;
  cv::Mat aligned_, aligned_gray_, squared_error_, upsampled_error_;
  std::vector<SharpnessPyramid::Buffers> strips_;  // each thread works at one
};

}  // namespace all_in_focus::core
