// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

constexpr int kNoFrame = 65535;  ///< source index of a pixel that no frame has won

enum class Mode {
  kPaper,     ///< Liu et al. 2019 as printed, for comparison
  kRefined,   ///< ours
  kRestored,  ///< refined; then BracketRestoration removes the blur beside occlusions
};

/// Its name for people: paper, refined, restored.
const char* name(Mode mode);
/// The mode of that name. Throws std::invalid_argument.
Mode parseMode(const std::string& text);

/// What is known about a scene before the first frame of its bracket. Every member may be missing.
struct BracketScene {
  cv::Mat labels;    ///< CV_32SC1, >= 0, any size; empty = none
  cv::Mat depth;     ///< CV_16UC1 mm, 0 = unknown, seen from the colour camera, holes filled, any size
  cv::Mat measured;  ///< the same before its holes were filled; empty: everything was measured
  Optics optics;
  std::optional<Camera> camera;  ///< the colour camera; none: the blur of frames cannot be predicted
  double pixel_pitch_mm = 0;     ///< of that camera at its calibrated size; 0 = f / fx

  /// The same, never 0. There must be a camera.
  double calibratedPitch() const {
    return pixel_pitch_mm > 0 ? pixel_pitch_mm : optics.focal_length_mm / camera->fx;
  }
};

/// What the prediction of blur assumes about the registered depth.
struct DefocusConfig {
  /// How far the edges of the registered depth lie from those of the picture: standard deviation in pixels of
  /// a picture 640 wide (a depth sensor's own resolution), more in wider ones.
  double edge_error_px = 2.0;
  bool edge_uncertainty = true;  ///< take edges for that uncertain
  bool hole_doubt = true;        ///< trust filled depth less than measured
};

/// The parts of mode refined. Each can be switched off, to measure what it brings.
struct RefinedConfig {
  bool alignment = true;   ///< warp frames to the geometry of the reference
  bool exposure = true;    ///< match their exposure to that of the reference
  bool prediction = true;  ///< predict the blur from depth and optics (DefocusPrediction)
  DefocusConfig defocus;
  bool scales = true;      ///< measure sharpness at every scale; false: at the finest only
  bool brightness = true;  ///< of frames that look equally sharp, prefer the darker, if codes are sRGB
  bool noise = true;       ///< weigh by the measured noise, too
  bool soft = true;        ///< weighted mean; false: the heaviest frame is copied
  bool choice = true;      ///< record which frame each pixel comes from; false: takes less memory
};

/// How a bracket was fused.
enum class FusedBy {
  kRegions,    ///< one frame a region (RegionFusion, mode paper with labels)
  kPixels,     ///< pixel by pixel, by sharpness, depth and optics (RefinedFusion)
  kSharpness,  ///< pixel by pixel, by sharpness alone
  kRestored,   ///< as kPixels or kSharpness, then corrected beside depth edges (BracketRestoration)
};

/// Its name in FusionReport: paper, refined, sharpness, restored.
const char* name(FusedBy fused_by);

/// Which frame a region was taken from.
struct RegionChoice {
  int label = 0;
  int frame = kNoFrame;
  double score = 0;   ///< normalised variance of that frame in the region; refined: share of pixels it won
  double margin = 0;  ///< 1 - runner-up / score: 0 = a draw, 1 = no rival
  double confidence = 0;  ///< mean over the region, 0..1
};

/// The result of one bracket.
struct FusionResult {
  cv::Mat image;  ///< CV_8UC3
  // Mode refined leaves these three empty without RefinedConfig::choice.
  cv::Mat source_index;  ///< CV_16UC1, the frame that a pixel was taken from, or mostly; kNoFrame = none
  cv::Mat confidence;    ///< CV_8UC1, margin of the choice, 0..255
  std::vector<RegionChoice> regions;  ///< by label; empty without labels
  std::vector<std::string> notes;     ///< for the user: regions that are sharp in no frame
};

/// A frame as mode refined adds it: in the geometry of the reference.
struct AlignedFrame {
  cv::Mat image;    ///< CV_8UC3; its pixels are valid only during the call that hands it over
  cv::Rect seen;    ///< pixels that the frame has seen; the others continue its border
  double gain = 1;  ///< in linear light (sRGB), to the exposure of the reference
  int index = 0;
  double focus_mm = 0;  ///< NaN = unknown, may be infinite
  bool linear = false;  ///< the bracket's codes are in proportion to light, not sRGB
};

class RefinedFusion;
class RegionFusion;

/// All-in-focus image of one bracket, frame by frame. Memory does not grow with the number of frames: the
/// mean or the chosen pixels are kept, not the frames. Not thread-safe; buffers are reused from bracket to
/// bracket.
///
/// Mode paper takes frames in any order. Mode refined takes the reference first, after observing what comes
/// before it in the bracket (see RefinedFusion).
class BracketFusion {
 public:
  BracketFusion();
  BracketFusion(BracketFusion&&) noexcept;
  BracketFusion& operator=(BracketFusion&&) noexcept;
  ~BracketFusion();

  /// Starts a bracket. The scene's images are shared, not copied; labels are scaled to the frames by nearest
  /// neighbour. Throws std::invalid_argument on images of another type, a negative label, impossible optics.
  void begin(const BracketScene& scene, Mode mode, const RefinedConfig& config = {});

  /// Shows a frame that will be added later; call in the order of the bracket. Otherwise as add(). Does
  /// nothing in mode paper.
  void observe(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus);

  /// frame: CV_8UC3, not empty, of the size of the bracket's first (else std::invalid_argument, and the
  /// bracket is as before). index: 0..65534, names the frame in the result. focus_mm: NaN = unknown, may be
  /// infinite. Returns why the frame does not fit the others and was left out, or "".
  std::string add(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus);

  /// Sets a function that receives each aligned frame from the next add() on, the reference first. add()
  /// calls it. Mode paper aligns no frames.
  void handAlignedFramesTo(std::function<void(const AlignedFrame&)> taker);

  int frames() const { return static_cast<int>(focus_mm_.size()); }  ///< used since begin()
  FusedBy fusedBy() const;

  /// The result of the frames so far; images are copies. Throws std::logic_error before the first frame.
  FusionResult result() const;

  static constexpr double kUnknownFocus = std::numeric_limits<double>::quiet_NaN();

 private:
  void accept(const cv::Mat& frame, int index);

  BracketScene scene_;
  RefinedConfig config_;
  cv::Size size_;                 // empty before the first frame
  std::vector<double> focus_mm_;  // of the frames used
  bool by_region_ = false;
  std::unique_ptr<RegionFusion> regions_;
  std::unique_ptr<RefinedFusion> refined_;
  cv::Mat labels_;  // of the frames' size
  cv::Mat gray_;
};

}  // namespace all_in_focus::core
