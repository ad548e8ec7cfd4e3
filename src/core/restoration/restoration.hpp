// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fusion/bracket_fusion.hpp"
#include "optics/focus_votes.hpp"
#include "optics/lens_fit.hpp"

namespace all_in_focus::core {

struct ObservedBracket;

/// The result of mode restored.
struct RestorationResult {
  cv::Mat image;  ///< CV_8UC3: the fused picture, corrected beside depth edges and where no frame is sharp
  cv::Mat depth;  ///< CV_16UC1 mm, known everywhere: estimated from the bracket, measured depth being a prior
  std::string refusal;             ///< why it is not restored; "" = it is. Else there is only `blur_scale`
  double blur_scale = 0;           ///< measured blur / blur that the optics predict; 0 = unknown
  double kept = 1;                 ///< share of the correction that the frames confirm; the rest is left out
  std::vector<std::string> notes;  ///< for the user: optics that the pictures contradict
};

/// Mode restored: removes the blur of near objects from the surfaces behind them.
///
/// Beside an occlusion no frame is right: in the frame that is focused on the far surface the near object's
/// blur lies over it. But all frames of a bracket show one sharp picture through one lens. The depth map that
/// explains the frames best is found first, then the correction of the fused picture that explains them
/// better. See docs/algorithms.md.
///
/// Holds at most kMostFrames frames, however long the bracket and however large its frames. They are
/// downsampled to 1.2 million pixels or, where depth predicts strong blur, to fewer; without depth to 0.4
/// million. The correction is upsampled. Not thread-safe.
class BracketRestoration {
 public:
  static constexpr int kMostFrames = 12;

  /// Receives how much of the work is done, 0..1; returns false to stop it.
  using Progress = std::function<bool(double done)>;

  /// Starts a bracket. The scene must be possible (Bracket checks it); its images are shared, not copied.
  void begin(const BracketScene& scene);

  /// Holds a downsampled copy of a frame. If there are too many frames, it keeps those that lie most evenly
  /// in dioptres over the scene. It ignores a frame whose focus distance is unknown.
  void add(const AlignedFrame& frame);

  /// Where no focus distance is known: takes them, in even steps, from the frames in which surfaces of known
  /// depth are sharpest. False: there is no depth or no camera, or the frames do not agree on a list.
  bool findFocus();

  /// What is missing for a restoration, as text for a user; "" = restore() will work.
  std::string missing() const;

  /// Nothing may be missing(). fused: CV_8UC3 or CV_16UC3 of the frames' size, the result of mode refined.
  /// exact: if the camera moved, the index of the frame whose geometry the picture has. Contours of the
  /// others may be a pixel off, or more. Empty when progress said stop.
  std::optional<RestorationResult> restore(const cv::Mat& fused, const Progress& progress = {},
                                           std::optional<int> exact = {}) const;

 private:
  struct HeldFrame {
    cv::Mat image;    ///< CV_8UC3, downsampled
    cv::Mat1b shown;  ///< 0 where its pixels are not valid, else 255
    double gain = 1;
    int index = 0;             ///< of the bracket
    double inverse_depth = 0;  ///< 1 / focus distance, 1/mm
  };
  void dropOne();
  ObservedBracket observed(const cv::Mat& fused, std::optional<int> exact) const;
  std::vector<cv::Mat> images() const;
  FocusVotes votes() const;
  LensFit lens(const ObservedBracket& bracket) const;
  double shrinking() const;
  bool hasScale() const { return scene_.camera && focus_known_; }
  void tell(const LensFit& fit, RestorationResult& result) const;

  BracketScene scene_;
  cv::Size size_;          // of the frames; empty before the first
  cv::Size working_size_;  // of those held
  bool focus_known_ = false, linear_ = false;
  std::vector<HeldFrame> held_;  // by inverse depth
};

}  // namespace all_in_focus::core
