// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "alignment/bracket_alignment.hpp"
#include "all_in_focus/fusion.hpp"
#include "optics/focus_votes.hpp"
#include "optics/lens_fit.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {

/// Asks the frames up to the reference, by small copies of them, whether f-number and focus distances are
/// right, and corrects them for the prediction of blur.
class LensCheck {
 public:
  /// Call it once. The scene's images are shared, not copied. pixel_pitch_mm, size, center: of the frames.
  void begin(const BracketScene& scene, double pixel_pitch_mm, const cv::Size& size,
             const cv::Point2d& center);

  /// The next frame of the bracket, of known focus distance. gray: CV_8UC1; empty: behind the reference.
  void observe(const cv::Mat& gray, int index, double focus_mm);

  /// Compares the frames observed so far. Call when the last of them is the reference. curve: of the camera;
  /// placement: of a frame, by index, relative to the reference.
  void ask(const LightCurve& curve, const std::function<Placement(int)>& placement);

  /// False: the numbers are wrong and cannot be corrected, so that a prediction would mislead.
  bool mayPredict() const { return may_predict_; }

  /// Corrected f-number.
  double aperture() const { return scene_.optics.aperture / fit_.scale; }

  /// Corrected focus distance of a frame that has been observed, mm. What comes next is not known yet: there
  /// the list goes on in even steps.
  double focusOf(int index) const;

  /// What the frames say against the numbers, and what is done about it: for the user, a line each.
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  struct Copy {
    int index;
    cv::Mat gray;  // small, CV_8UC1
    DetailMap detail;
  };
  /// The copies in the geometry and exposure of the reference.
  struct Compared {
    std::vector<BlurEvidence::Frame> frames;
    std::vector<FocusVotes::Frame> details;
    std::vector<FrameBlur> blur;
    cv::Mat fused;  // CV_8UC1
  };
  Compared compare(const std::vector<Copy>& copies, const std::function<Placement(int)>& placement) const;
  const cv::Mat& depth() const { return scene_.measured.empty() ? scene_.depth : scene_.measured; }
  void refuse(const char* reason);

  BracketScene scene_;
  double pixel_pitch_mm_ = 0;
  cv::Size size_;
  cv::Point2d center_;
  double shrinking_ = 1;      // a whole number, with which it is quick
  std::vector<Copy> copies_;  // at equal steps
  int step_ = 1, observed_ = 0;
  std::map<int, double> focus_mm_;  // by index, as given
  bool may_predict_ = true;
  LensFit fit_;
  std::vector<std::string> notes_;
};

}  // namespace all_in_focus::core
