// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/pipeline.hpp"

#include <chrono>
#include <stdexcept>

namespace all_in_focus::core {
namespace {

class Stopwatch {
 public:
  /// Milliseconds since construction or the last lap.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace

DepthPreprocessing::DepthPreprocessing(const Rig& rig, Mode mode)
    : mode_(mode), registration_(rig, mode == Mode::kPaper ? Splat::kPoint : Splat::kFootprint) {}

void DepthPreprocessing::compute(const cv::Mat& depth, cv::Mat& registered, cv::Mat& filled) {
  registration_.compute(depth, registered);  // equations 1 to 3
  if (mode_ == Mode::kPaper) {
    dilateDepth(registered, filled);  // equation 4
    DiffusionFilling().fill(filled);  // equations 5 to 8
  } else {
    far_side_.fill(registered, filled);
  }
}

SegmentationConfig segmentationConfig(Mode mode, const Optics& optics, DofSpan span, int min_region_size) {
  return {optics, span, min_region_size, mode == Mode::kPaper};
}

PipelineResult runPipeline(const PipelineInput& input, Mode mode) {
  PipelineResult result;
  Stopwatch watch;

  // 1. Registration, dilation and hole filling (equations 1 to 8).
  if (!input.depth.empty()) {
    DepthPreprocessing(input.rig, mode).compute(input.depth, result.registered, result.filled);
  } else {
    result.registered = result.filled = input.registered_depth;
  }
  result.depth_ms = watch.lap();

  // 2. Regions that each fit inside one depth of field (equations 9 and 10).
  if (!result.filled.empty()) {
    DofSegmentation(segmentationConfig(mode, input.optics, input.span))
        .compute(result.filled, result.segmentation);
  } else {
    result.segmentation.labels = input.labels;
  }
  result.segmentation_ms = watch.lap();

  // 3. Every region from the frame in which it is sharpest (normalised variance; equation 11 with W = 0 or
  // 1).
  BracketFusion fusion;
  fusion.begin(result.segmentation.labels);
  for (cv::Mat frame; input.next_frame(frame); ++result.frames) {
    watch.lap();
    fusion.add(frame, result.frames);
    result.fusion_ms += watch.lap();
  }
  if (result.frames == 0) throw std::invalid_argument("fusion: the bracket holds no frame");
  watch.lap();
  result.fusion = fusion.result();
  result.fusion_ms += watch.lap();
  return result;
}

}  // namespace all_in_focus::core
