// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/bracket.hpp"
#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/dof_segmentation.hpp"

namespace all_in_focus::core {

/// Turns depth of the sensor into depth of every colour pixel, as the node depth_preprocess does.
class DepthPreprocessing {
 public:
  DepthPreprocessing(const Rig& rig, Mode mode);

  /// depth: CV_16UC1 mm, 0 = unknown. registered: as measured, of the colour camera's size; filled: its holes
  /// filled. Both CV_16UC1 mm, 0 = unknown, and written in place where size and type fit.
  void compute(const cv::Mat& depth, cv::Mat& registered, cv::Mat& filled);

  const Rig& rig() const { return registration_.rig(); }

 private:
  Mode mode_;
  DepthRegistration registration_;
};

/// How a mode cuts regions: paper merges small ones as printed, refined keeps them.
SegmentationConfig segmentationConfig(Mode mode, const Optics& optics, DofSpan span = DofSpan::kPaper,
                                      int min_region_size = SegmentationConfig().min_region_size);

/// The frames of a bracket in their order, as often as they are needed.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual bool next(cv::Mat& frame) = 0;  ///< as Bracket::add() takes it; false at the end
  virtual void rewind() = 0;
  virtual int count() = 0;  ///< may take as long as reading them all
};

/// One bracket and what is known about its scene: depth with its rig, or registered depth, or labels, or
/// nothing.
struct PipelineInput {
  cv::Mat depth;  ///< CV_16UC1 mm, seen from the depth camera; needs the rig
  Rig rig;        ///< with registered depth only its colour camera is used, for the pixel pitch
  bool has_rig = false;
  double pixel_pitch_mm = 0;  ///< of the colour camera; 0 = the lens is that of the calibration: f / fx
  cv::Mat registered_depth;   ///< CV_16UC1 mm, seen from the colour camera, used as it is
  cv::Mat labels;             ///< CV_32SC1, any distinct values >= 0
  Optics optics;
  DofSpan span = DofSpan::kPaper;
  FrameSource* frames = nullptr;
  std::vector<double> focus_mm;                 ///< of each frame, NaN = unknown; empty: of none
  int reference = BracketSettings().reference;  ///< auto: the middle one, N / 2
  RefinedConfig refined;
  std::function<void(const AlignedFrame&)> on_aligned;  ///< see BracketSettings
  std::function<std::string(int index)> frame_name;     ///< what messages call a frame; none: "frame 7"
  Bracket::Progress progress;  ///< of the restoration; false = stop: the result is refined
};

/// The result of one run.
struct PipelineResult {
  cv::Mat registered, filled;  ///< empty when there was no depth
  Segmentation segmentation;   ///< no segments when labels were given; no labels when nothing was known
  BracketResult bracket;
  double depth_ms = 0, segmentation_ms = 0;
};

/// The whole method, from a depth map and a focus bracket to the all-in-focus image. Buffers, and what
/// follows from rig and optics, are kept from run to run. Not thread-safe.
class Pipeline {
 public:
  explicit Pipeline(Mode mode) : mode_(mode) {}

  /// Throws std::invalid_argument on bad input, also when the bracket is empty or has no such reference. Mode
  /// refined reads the frames up to the reference twice, so that none needs to be kept.
  PipelineResult run(const PipelineInput& input);

 private:
  BracketResult fuse(const PipelineInput& input, const BracketScene& scene);

  Mode mode_;
  std::unique_ptr<DepthPreprocessing> preprocessing_;
  std::unique_ptr<DofSegmentation> segmentation_;
  Bracket bracket_;
};

}  // namespace all_in_focus::core
