// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/pipeline.hpp"

#include "all_in_focus/hole_filling.hpp"
#include "util/stopwatch.hpp"

namespace all_in_focus::core {
namespace {

// Reads frames by index from a source that only goes forward: a frame that has been read already costs a
// rewind.
class FrameReader {
 public:
  explicit FrameReader(FrameSource& source) : source_(source) {}

  /// False: the source ends before that frame.
  bool read(int index) {
    const bool is_gone = next_ > 0 && frame_.empty();  // a source may release it at its end
    if (index < next_ - 1 || is_gone) {
      source_.rewind();
      next_ = 0;
    }
    for (; next_ <= index; ++next_) {
      frame_.release();  // else a video would overwrite a frame that Bracket still has
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

}  // namespace

DepthPreprocessing::DepthPreprocessing(const Rig& rig, Mode mode)
    : mode_(mode), registration_(rig, mode == Mode::kPaper ? Splat::kPoint : Splat::kFootprint) {}

void DepthPreprocessing::compute(const cv::Mat& depth, cv::Mat& registered, cv::Mat& filled) {
  registration_.compute(depth, registered);  // equations 1 to 3
  if (mode_ == Mode::kPaper) {
    dilateDepth(registered, filled);  // equation 4
    fillByDiffusion(filled);          // equations 5 to 8
  } else {
    fillFromFarSide(registered, filled);
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
  // W = 0 or 1). Mode refined: a weighted mean, pixel by pixel. Mode restored: then the correction that makes
  // the result explain the frames beside occlusions.
  BracketScene scene;
  scene.labels = result.segmentation.labels;
  scene.depth = result.filled;
  if (!input.depth.empty()) scene.measured = result.registered;
  scene.optics = input.optics;
  scene.pixel_pitch_mm = input.pixel_pitch_mm;
  if (input.has_rig) scene.camera = input.rig.color;
  result.bracket = fuse(input, scene);
  return result;
}

BracketResult Pipeline::fuse(const PipelineInput& input, const BracketScene& scene) {
  const bool middle = input.reference == BracketSettings::kAutoReference;
  BracketSettings settings;
  settings.mode = mode_;
  settings.refined = input.refined;
  settings.reference = input.reference;
  if (middle && mode_ != Mode::kPaper) settings.length = input.frames->count();
  settings.strict = true;
  settings.on_aligned = input.on_aligned;
  settings.frame_name = input.frame_name;
  FrameReader reader(*input.frames);
  bracket_.begin(scene, settings, [&reader](int index) {
    reader.read(index);
    return reader.frame();
  });
  int count = 0;
  for (; reader.read(count); ++count) {
    const bool has_focus = count < static_cast<int>(input.focus_mm.size());
    bracket_.add(reader.frame(), count, has_focus ? input.focus_mm[count] : kUnknownFocus);
  }
  BracketResult result = bracket_.finish(input.progress);
  if (result.stopped) result.notes.emplace_back("not restored: stopped");
  // Mode paper has no use for the reference, so the frames need not be counted in advance.
  if (middle && mode_ == Mode::kPaper) result.reference = count / 2;
  return result;
}

}  // namespace all_in_focus::core
