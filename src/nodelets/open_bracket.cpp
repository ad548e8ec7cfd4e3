// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "open_bracket.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <chrono>
#include <cstdlib>
#include <stdexcept>

namespace all_in_focus {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxNotes = 20;  // of one report

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// The image without a copy where it is bgr8 already.
cv_bridge::CvImageConstPtr toBgr(const sensor_msgs::ImageConstPtr& image) {
  const std::size_t least = std::size_t{image->step} * image->height;
  if (image->width == 0 || image->height == 0 || image->data.size() < least) {
    throw std::invalid_argument("colour image of size 0 or with too little data: check the camera's driver");
  }
  return cv_bridge::toCvShare(image, sensor_msgs::image_encodings::BGR8);
}

}  // namespace

std::string OpenBracket::begin(const std_msgs::Header& first_frame, std::uint32_t bracket_id, Mode mode,
                               int wanted_reference, const LabelSet& set) {
  set_ = set;
  report_ = FusionReport();
  report_.header = first_frame;
  report_.bracket_id = bracket_id;
  wanted_reference_ = wanted_reference;
  fusion_ms_ = label_wait_ms_ = 0;
  if (mode == Mode::kRefined)
    note("refined fusion is not in this version: regions are fused as in mode paper");
  std::string trouble;
  if (!set.labels)
    trouble = "no label image in time for the bracket: fused by sharpness alone (is the segmenter running?)";
  try {
    if (set.labels)
      fusion_.begin(cv_bridge::toCvShare(set.labels, sensor_msgs::image_encodings::TYPE_32SC1)->image);
  } catch (const std::exception& e) {
    trouble = std::string("label image refused, fused by sharpness alone: ") + e.what();
  }
  report_.has_labels = trouble.empty();
  report_.mode = report_.has_labels ? "paper" : "sharpness";
  if (report_.has_labels) {
    report_.label_stamp = set.labels->header.stamp;
    report_.optics = set.segments->optics;
  } else {
    fusion_.begin(cv::Mat());
    note(trouble);
  }
  return trouble;
}

std::string OpenBracket::add(const sensor_msgs::ImageConstPtr& image, int index) {
  ++report_.frames_seen;
  try {
    const cv_bridge::CvImageConstPtr bgr = toBgr(image);
    const Clock::time_point start = Clock::now();
    fusion_.add(bgr->image, index);
    fusion_ms_ += millisecondsSince(start);
  } catch (const std::exception& e) {
    ++report_.frames_rejected;
    note("frame " + std::to_string(index) + " rejected: " + e.what());
    return e.what();
  }
  if (report_.frames_used++ == 0 || nearerToReference(index)) {
    report_.reference = static_cast<std::uint32_t>(index);
    report_.header = image->header;
  }
  return "";
}

bool OpenBracket::nearerToReference(int index) const {
  return std::abs(index - wanted_reference_) <
         std::abs(static_cast<int>(report_.reference) - wanted_reference_);
}

void OpenBracket::note(const std::string& text) {
  if (report_.notes.size() < kMaxNotes) report_.notes.push_back(text);
}

FusedBracket OpenBracket::fused(int missing) {
  const Clock::time_point start = Clock::now();
  FusedBracket bracket;
  if (report_.frames_used > 0) bracket.result = fusion_.result();
  fusion_ms_ += millisecondsSince(start);

  bracket.report = boost::make_shared<FusionReport>(report_);
  FusionReport& report = *bracket.report;
  report.frames_missing = static_cast<std::uint32_t>(missing);
  for (const RegionChoice& choice : bracket.result.regions) {
    SegmentChoice message;
    message.label = static_cast<std::uint32_t>(choice.label);
    message.frame = static_cast<std::uint16_t>(choice.frame);
    message.score = choice.score;
    message.margin = choice.margin;
    report.segments.push_back(message);
  }
  report.timing_names = {"label_wait", "fusion"};
  report.timing_ms = {label_wait_ms_, fusion_ms_};
  return bracket;
}

}  // namespace all_in_focus
