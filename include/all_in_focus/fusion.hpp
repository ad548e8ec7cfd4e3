// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

constexpr int kNoFrame = 65535;  ///< source index of a pixel that no frame has won
constexpr double kUnknownFocus = std::numeric_limits<double>::quiet_NaN();  ///< mm

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

/// The parts of mode refined. Each can be switched off, to measure what it brings.
struct RefinedConfig {
  bool alignment = true;   ///< warp frames to the geometry of the reference
  bool exposure = true;    ///< match their exposure to that of the reference
  bool prediction = true;  ///< predict the blur from depth and optics (DefocusPrediction)
  bool scales = true;      ///< measure sharpness at every scale; false: at the finest only
  bool brightness = true;  ///< of frames that look equally sharp, prefer the darker, if codes are sRGB
  bool noise = true;       ///< weigh by the measured noise, too
  bool soft = true;        ///< weighted mean; false: the heaviest frame is copied
  bool choice = true;      ///< record which frame each pixel comes from; false: takes less memory
};

/// A frame as mode refined adds it: in the geometry of the reference.
struct AlignedFrame {
  cv::Mat image;    ///< CV_8UC3 or CV_16UC3; its pixels are valid only during the call that hands it over
  cv::Rect seen;    ///< pixels that the frame has seen; the others continue its border
  double gain = 1;  ///< in linear light (sRGB), to the exposure of the reference
  int index = 0;
  double focus_mm = 0;  ///< NaN = unknown, may be infinite
  bool linear = false;  ///< the bracket's codes are in proportion to light, not sRGB
  cv::Mat opaque = {};  ///< CV_8UC1, 0 where pixels show nothing and weigh nothing; empty: nowhere
};

/// Its picture in the exposure of the reference, as the mean gets it.
cv::Mat withGain(const AlignedFrame& frame);

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
  cv::Mat image;  ///< CV_8UC3, or CV_16UC3 if the first frame had 16 bits
  // Mode refined leaves these three empty without RefinedConfig::choice.
  cv::Mat source_index;  ///< CV_16UC1, the frame that a pixel was taken from, or mostly; kNoFrame = none
  cv::Mat confidence;    ///< CV_8UC1, margin of the choice, 0..255
  std::vector<RegionChoice> regions;    ///< by label; empty without labels
  std::vector<std::string> notes;       ///< for the user: what is sharp in no frame, how the camera moved
  std::vector<std::string> lens_notes;  ///< for the user: what the frames say against the lens data
};

}  // namespace all_in_focus::core
