// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/bracket_fusion.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

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

}  // namespace

void BracketFusion::begin(const cv::Mat& labels) {
  if (!labels.empty() && labels.type() != CV_32SC1)
    throw std::invalid_argument("fusion: labels must be CV_32SC1");
  double smallest = 0;
  if (!labels.empty()) cv::minMaxLoc(labels, &smallest);
  if (smallest < 0) throw std::invalid_argument(cv::format("fusion: negative label %g", smallest));
  labels_ = labels;
  by_region_ = !labels.empty();
  frames_ = 0;
  size_ = {};
}

void BracketFusion::add(const cv::Mat& frame, int index) {
  if (frame.type() != CV_8UC3 || frame.empty()) {
    throw std::invalid_argument("fusion: frame " + std::to_string(index) + " must be CV_8UC3 and not empty");
  }
  if (index < 0 || index >= kNoFrame) {
    throw std::invalid_argument("fusion: frame index " + std::to_string(index) + " is not in 0..65534");
  }
  if (frames_ > 0 && frame.size() != size_) {
    throw std::invalid_argument("fusion: frame " + std::to_string(index) + " is " + text(frame.size()) +
                                ", but the bracket began with " + text(size_));
  }
  if (frames_ == 0 && by_region_ && !sameShape(labels_.size(), frame.size())) {
    throw std::invalid_argument("fusion: the frame is " + text(frame.size()) + ", the label image " +
                                text(labels_.size()) + ": not the same picture");
  }
  if (frames_ == 0) {
    size_ = frame.size();
    if (by_region_) {
      cv::Mat labels = labels_;
      if (labels.size() != size_) cv::resize(labels_, labels, size_, 0, 0, cv::INTER_NEAREST);
      regions_.begin(labels);
    } else {
      sharpness_.begin(size_);
    }
  }
  cv::cvtColor(frame, gray_, cv::COLOR_BGR2GRAY);
  by_region_ ? regions_.add(frame, gray_, index) : sharpness_.add(frame, gray_, index);
  ++frames_;
}

FusionResult BracketFusion::result() const {
  if (frames_ == 0) throw std::logic_error("fusion: no frame yet");
  if (!by_region_)
    return {sharpness_.image().clone(), sharpness_.sourceIndex().clone(), sharpness_.confidence(), {}};
  return {regions_.image().clone(), regions_.sourceIndex(), regions_.confidence(), regions_.choices()};
}

}  // namespace all_in_focus::core
