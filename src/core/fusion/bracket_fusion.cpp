// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/bracket_fusion.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "all_in_focus/codes.hpp"
#include "fusion/region_summary.hpp"
#include "util/transparency.hpp"

namespace all_in_focus::core {

void BracketFusion::begin(const BracketScene& scene, const cv::Size& size, Mode mode,
                          const RefinedConfig& config) {
  scene_ = scene;
  config_ = config;
  size_ = size;
  focus_mm_.clear();
  depth_ = -1;
  setLabels(scene.labels);
  by_region_ = mode == Mode::kPaper && !labels_.empty();
  if (mode == Mode::kPaper) {
    // Without regions the sharpest frame a pixel, plainly copied.
    scene_.depth = cv::Mat();
    config_.alignment = config_.exposure = config_.soft = false;
  }
  if (by_region_) {
    regions_.begin(labels_);
  } else {
    refined_.begin(scene_, config_, size);
  }
}

void BracketFusion::setLabels(const cv::Mat& labels) {
  labels_ = labels;
  if (!labels.empty() && labels.size() != size_) cv::resize(labels, labels_, size_, 0, 0, cv::INTER_NEAREST);
}

// Checks a frame.
void BracketFusion::takeApart(const cv::Mat& frame, int index) {
  const bool is_color =
      (frame.depth() == CV_8U || frame.depth() == CV_16U) && (frame.channels() == 3 || frame.channels() == 4);
  if (!is_color || frame.size() != size_) {
    throw std::invalid_argument(
        cv::format("fusion: frame %d must have 8 or 16 bits, three or four channels and be %dx%d", index,
                   size_.width, size_.height));
  }
  if (index < 0 || index >= kNoFrame)
    throw std::invalid_argument(cv::format("fusion: frame index %d is not in 0..65534", index));
  if (depth_ < 0) depth_ = frame.depth();
  color_ = toBits(contentOf(frame, opaque_), depth_);
  cv::cvtColor(toEightBits(color_), gray_, cv::COLOR_BGR2GRAY);
}

void BracketFusion::observe(const cv::Mat& frame, int index, double focus_mm) {
  takeApart(frame, index);
  if (!by_region_) refined_.observe(gray_, index, focus_mm);
}

std::string BracketFusion::add(const cv::Mat& frame, int index, double focus_mm, bool may_wait) {
  takeApart(frame, index);
  if (by_region_) {
    regions_.add(color_, gray_, index);
  } else {
    std::string rejection = refined_.add(color_, gray_, index, focus_mm, opaque_, may_wait);
    if (!rejection.empty()) return rejection;
  }
  focus_mm_.push_back(focus_mm);
  return "";
}

std::string BracketFusion::misfit(int index, int other) const {
  return by_region_ ? "" : refined_.misfit(index, other);
}

FrameGroup BracketFusion::largestGroup() const {
  return by_region_ ? FrameGroup() : refined_.largestGroup();
}

void BracketFusion::setAlignedFrameCallback(std::function<void(const AlignedFrame&)> callback) {
  refined_.setAlignedFrameCallback(std::move(callback));
}

FusedBy BracketFusion::fusedBy() const {
  if (by_region_) return FusedBy::kRegions;
  return labels_.empty() && scene_.depth.empty() ? FusedBy::kSharpness : FusedBy::kPixels;
}

FusionResult BracketFusion::result() const {
  if (focus_mm_.empty()) throw std::logic_error("fusion: no frame yet");
  FusionResult result;
  if (by_region_) {
    result.image = regions_.image().clone();
    result.source_index = regions_.sourceIndex();
    result.confidence = regions_.confidence();
    result.regions = regions_.choices();
  } else {
    result.image = refined_.image();
    if (config_.choice) {
      result.source_index = refined_.sourceIndex().clone();
      result.confidence = refined_.confidence();
      if (!labels_.empty())
        result.regions = summarizeRegions(labels_, result.source_index, result.confidence);
    }
    result.notes = unreachedDistances(scene_, focus_mm_);
    result.lens_notes = refined_.lensNotes();
    if (std::string note = refined_.driftNote(); !note.empty()) result.notes.push_back(std::move(note));
  }
  return result;
}

std::string BracketFusion::hiddenDriftNote() const {
  return by_region_ ? "" : refined_.hiddenDriftNote();
}

}  // namespace all_in_focus::core
