// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/pipeline.hpp"

#include <chrono>
#include <functional>
#include <optional>
#include <stdexcept>

#include "all_in_focus/frame_order.hpp"

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

[[noreturn]] void refuseReference(int reference, int frames) {
  throw std::invalid_argument(
      frames == 0 ? std::string("fusion: the bracket holds no frame")
                  : cv::format("fusion: frame %d cannot be the reference: the bracket holds frames 0 to %d",
                               reference, frames - 1));
}

// Reads frames by index from a source that only goes forward: a frame that has been read already costs a
// rewind.
class FrameReader {
 public:
  explicit FrameReader(FrameSource& source) : source_(source) {}

  /// False: the source ends before that frame.
  bool read(int index) {
    if (index < next_ - 1) {
      source_.rewind();
      next_ = 0;
    }
    for (; next_ <= index; ++next_) {
      if (!source_.next(frame_)) return false;
    }
    return true;
  }
  const cv::Mat& frame() const { return frame_; }

 private:
  FrameSource& source_;
  cv::Mat frame_;
  int next_ = 0;  // index that source_.next() gives
};

// Fuses all frames in the order of FrameOrder.
void fuseFrames(const PipelineInput& input, Mode mode, BracketFusion& fusion, PipelineResult& result) {
  const auto focus = [&](int index) {
    return index < static_cast<int>(input.focus_mm.size()) ? input.focus_mm[index]
                                                           : BracketFusion::kUnknownFocus;
  };
  const bool middle = input.reference == PipelineInput::kAutoReference;
  const int first = mode == Mode::kPaper ? 0 : middle ? input.frames->count() / 2 : input.reference;
  FrameReader reader(*input.frames);
  FrameOrder order(mode, first);
  Stopwatch watch;
  for (result.frames = 0; reader.read(result.frames); ++result.frames) {
    order.arrived(result.frames);
    if (order.isHolding()) {
      watch.lap();
      fusion.observe(reader.frame(), result.frames, focus(result.frames));
      result.fusion_ms += watch.lap();
    }
    while (const std::optional<int> index = order.next()) {
      reader.read(*index);
      watch.lap();
      const std::string rejection = fusion.add(reader.frame(), *index, focus(*index));
      result.fusion_ms += watch.lap();
      order.done(*index, rejection.empty());
      if (!rejection.empty())
        result.rejections.push_back("frame " + std::to_string(*index) + " rejected: " + rejection);
    }
  }
  if (order.isHolding() || result.frames == 0) refuseReference(first, result.frames);
  result.reference = middle ? result.frames / 2 : input.reference;
  if (result.reference < 0 || result.reference >= result.frames)
    refuseReference(result.reference, result.frames);
}

// Corrects a result of mode refined, or says why it cannot.
void restore(const BracketRestoration& restoration, const BracketRestoration::Progress& progress,
             PipelineResult& result) {
  if (!restoration.missing().empty()) {
    result.fusion.notes.push_back("not restored: " + restoration.missing());
    return;
  }
  const std::optional<RestorationResult> restored = restoration.restore(result.fusion.image, progress);
  if (!restored) {
    result.fusion.notes.push_back("not restored: stopped");
    return;
  }
  result.fusion.image = restored->image;
  result.restored_depth = restored->depth;
  result.blur_scale = restored->blur_scale;
  result.fusion.notes.insert(result.fusion.notes.end(), restored->notes.begin(), restored->notes.end());
  result.fused_by = FusedBy::kRestored;
}

}  // namespace

DepthPreprocessing::DepthPreprocessing(const Rig& rig, Mode mode)
    : mode_(mode), registration_(rig, mode == Mode::kPaper ? Splat::kPoint : Splat::kFootprint) {}

void DepthPreprocessing::compute(const cv::Mat& depth, cv::Mat& registered, cv::Mat& filled) {
  registration_.compute(depth, registered);  // equations 1 to 3
  if (mode_ == Mode::kPaper) {
    dilateDepth(registered, filled);  // equation 4
    diffusion_.fill(filled);          // equations 5 to 8
  } else {
    far_side_.fill(registered, filled);
  }
}

SegmentationConfig segmentationConfig(Mode mode, const Optics& optics, DofSpan span, int min_region_size) {
  return {optics, span, min_region_size, mode == Mode::kPaper};
}

PipelineResult Pipeline::run(const PipelineInput& input) {
  PipelineResult result;
  Stopwatch watch;

  // 1. Registration, dilation and hole filling (equations 1 to 8).
  if (!input.depth.empty()) {
    if (!preprocessing_ || !(preprocessing_->rig() == input.rig))
      preprocessing_ = std::make_unique<DepthPreprocessing>(input.rig, mode_);
    preprocessing_->compute(input.depth, result.registered, result.filled);
  } else {
    result.registered = result.filled = input.registered_depth;
  }
  result.depth_ms = watch.lap();

  // 2. Regions that each fit inside one depth of field (equations 9 and 10).
  if (!result.filled.empty()) {
    const SegmentationConfig config = segmentationConfig(mode_, input.optics, input.span);
    if (!segmentation_ || !(segmentation_->config() == config))
      segmentation_ = std::make_unique<DofSegmentation>(config);
    segmentation_->compute(result.filled, result.segmentation);
  } else {
    result.segmentation.labels = input.labels;
  }
  result.segmentation_ms = watch.lap();

  // 3. Mode paper: every region from the frame in which it is sharpest (normalised variance; equation 11 with
  // W = 0 or 1). Mode refined: a weighted mean, pixel by pixel.
  BracketScene scene;
  scene.labels = result.segmentation.labels;
  scene.depth = result.filled;
  if (!input.depth.empty()) scene.measured = result.registered;
  scene.optics = input.optics;
  if (input.has_rig) scene.camera = input.rig.color;
  const bool restores = mode_ == Mode::kRestored;
  fusion_.begin(scene, mode_, input.refined);
  if (restores) restoration_.begin(scene);
  fusion_.handAlignedFramesTo(restores ? [this](const AlignedFrame& frame) { restoration_.add(frame); }
                                       : std::function<void(const AlignedFrame&)>());
  fuseFrames(input, mode_, fusion_, result);
  result.fused_by = fusion_.fusedBy();
  watch.lap();
  result.fusion = fusion_.result();
  result.fusion_ms += watch.lap();

  // 4. Mode restored: the correction that makes the result explain the frames beside occlusions.
  if (restores) {
    restore(restoration_, input.progress, result);
    result.restoration_ms = watch.lap();
  }
  return result;
}

}  // namespace all_in_focus::core
