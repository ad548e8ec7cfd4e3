// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/bracket_fusion.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "fusion/refined_fusion.hpp"
#include "fusion/region_fusion.hpp"
#include "fusion/region_summary.hpp"

namespace all_in_focus::core {
namespace {

std::string text(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

// Sides in the same proportion, to 1 %.
bool sameShape(const cv::Size& a, const cv::Size& b) {
  const double stretch = static_cast<double>(a.width) * b.height / (static_cast<double>(a.height) * b.width);
  return std::abs(stretch - 1) <= 0.01;
}

void requireShape(const cv::Mat& image, const char* what, const cv::Size& frame) {
  if (image.empty() || sameShape(image.size(), frame)) return;
  throw std::invalid_argument("fusion: the frame is " + text(frame) + ", the " + what + " " +
                              text(image.size()) + ": not the same picture");
}

}  // namespace

const char* name(Mode mode) {
  return mode == Mode::kPaper ? "paper" : mode == Mode::kRefined ? "refined" : "restored";
}

Mode parseMode(const std::string& text) {
  for (const Mode mode : {Mode::kPaper, Mode::kRefined, Mode::kRestored}) {
    if (text == name(mode)) return mode;
  }
  throw std::invalid_argument("mode '" + text + "' is none of paper, refined, restored");
}

const char* name(FusedBy fused_by) {
  constexpr const char* kNames[] = {"paper", "refined", "sharpness", "restored"};  // in the order of FusedBy
  return kNames[static_cast<int>(fused_by)];
}

BracketFusion::BracketFusion()
    : regions_(std::make_unique<RegionFusion>()), refined_(std::make_unique<RefinedFusion>()) {}
BracketFusion::BracketFusion(BracketFusion&&) noexcept = default;
BracketFusion& BracketFusion::operator=(BracketFusion&&) noexcept = default;
BracketFusion::~BracketFusion() = default;

void BracketFusion::begin(const BracketScene& scene, Mode mode, const RefinedConfig& config) {
  if (!scene.labels.empty() && scene.labels.type() != CV_32SC1)
    throw std::invalid_argument("fusion: labels must be CV_32SC1");
  double smallest = 0;
  if (!scene.labels.empty()) cv::minMaxLoc(scene.labels, &smallest);
  if (smallest < 0) throw std::invalid_argument(cv::format("fusion: negative label %g", smallest));
  if (!scene.depth.empty() && scene.depth.type() != CV_16UC1)
    throw std::invalid_argument("fusion: depth must be CV_16UC1");
  validate(scene.optics);
  scene_ = scene;
  config_ = config;
  by_region_ = mode == Mode::kPaper && !scene.labels.empty();
  if (mode == Mode::kPaper) {
    // Without regions the sharpest frame a pixel, plainly copied.
    scene_.depth = cv::Mat();
    config_.alignment = config_.exposure = config_.soft = false;
  }
  size_ = {};
  focus_mm_.clear();
}

// Checks a frame, sets up for the bracket's first.
void BracketFusion::accept(const cv::Mat& frame, int index) {
  if (frame.type() != CV_8UC3 || frame.empty()) {
    throw std::invalid_argument("fusion: frame " + std::to_string(index) + " must be CV_8UC3 and not empty");
  }
  if (index < 0 || index >= kNoFrame) {
    throw std::invalid_argument("fusion: frame index " + std::to_string(index) + " is not in 0..65534");
  }
  if (!size_.empty() && frame.size() != size_) {
    throw std::invalid_argument("fusion: frame " + std::to_string(index) + " is " + text(frame.size()) +
                                ", but the bracket began with " + text(size_));
  }
  if (size_.empty()) {
    requireShape(scene_.labels, "label image", frame.size());
    requireShape(scene_.depth, "depth", frame.size());
    labels_ = scene_.labels;
    if (!labels_.empty() && labels_.size() != frame.size())
      cv::resize(scene_.labels, labels_, frame.size(), 0, 0, cv::INTER_NEAREST);
    if (by_region_) {
      regions_->begin(labels_);
    } else {
      refined_->begin(scene_, config_, frame.size());
    }
    size_ = frame.size();
  }
  cv::cvtColor(frame, gray_, cv::COLOR_BGR2GRAY);
}

void BracketFusion::observe(const cv::Mat& frame, int index, double focus_mm) {
  accept(frame, index);
  if (!by_region_) refined_->observe(gray_, index, focus_mm);
}

std::string BracketFusion::add(const cv::Mat& frame, int index, double focus_mm) {
  accept(frame, index);
  if (by_region_) {
    regions_->add(frame, gray_, index);
  } else {
    std::string rejection = refined_->add(frame, gray_, index, focus_mm);
    if (!rejection.empty()) return rejection;
  }
  focus_mm_.push_back(focus_mm);
  return "";
}

void BracketFusion::handAlignedFramesTo(std::function<void(const AlignedFrame&)> taker) {
  refined_->handAlignedFramesTo(std::move(taker));
}

FusedBy BracketFusion::fusedBy() const {
  if (by_region_) return FusedBy::kRegions;
  return scene_.labels.empty() && scene_.depth.empty() ? FusedBy::kSharpness : FusedBy::kPixels;
}

FusionResult BracketFusion::result() const {
  if (focus_mm_.empty()) throw std::logic_error("fusion: no frame yet");
  FusionResult result;
  if (by_region_) {
    result.image = regions_->image().clone();
    result.source_index = regions_->sourceIndex();
    result.confidence = regions_->confidence();
    result.regions = regions_->choices();
  } else {
    result.image = refined_->image();
    if (config_.choice) {
      result.source_index = refined_->sourceIndex().clone();
      result.confidence = refined_->confidence();
      if (!labels_.empty())
        result.regions = summarizeRegions(labels_, result.source_index, result.confidence);
    }
    result.notes = unreachedDistances(scene_, focus_mm_);
  }
  return result;
}

}  // namespace all_in_focus::core
