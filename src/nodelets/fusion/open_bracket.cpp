// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "open_bracket.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "stopwatch.hpp"

namespace all_in_focus {
namespace {

constexpr std::size_t kMaxNotes = 20;  // of one report, before those of the result
constexpr double kMmPerM = 1000;

// The image without a copy where it is bgr8 already.
cv_bridge::CvImageConstPtr toBgr(const sensor_msgs::ImageConstPtr& image) {
  const std::size_t least = std::size_t{image->step} * image->height;
  if (image->width == 0 || image->height == 0 || image->data.size() < least) {
    throw std::invalid_argument("colour image of size 0 or with too little data: check the camera's driver");
  }
  return cv_bridge::toCvShare(image, sensor_msgs::image_encodings::BGR8);
}

}  // namespace

std::vector<std::string> OpenBracket::begin(const std_msgs::Header& first_frame, std::uint32_t bracket_id,
                                            Mode mode, int reference, const SceneMessages& messages) {
  mode_ = mode;
  wanted_reference_ = reference;
  waiting_.clear();
  holding_ = mode == Mode::kRefined;
  report_ = FusionReport();
  report_.header = first_frame;
  report_.bracket_id = bracket_id;
  focus_known_ = focus_refused_ = false;
  fusion_ms_ = label_wait_ms_ = 0;

  std::string trouble;
  if (!messages.labels.labels)
    trouble = "no label image in time for the bracket: fused by sharpness alone (is the segmenter running?)";
  try {
    scene_ = toScene(messages, mode);
    fusion_.begin(scene_.scene, mode);
  } catch (const std::exception& e) {
    trouble = std::string("label image refused, fused by sharpness alone: ") + e.what();
    scene_ = {};
    fusion_.begin({}, mode);
  }
  report_.has_labels = trouble.empty();
  if (report_.has_labels) {
    report_.label_stamp = messages.labels.labels->header.stamp;
    report_.optics = messages.labels.segments->optics;
  } else {
    scene_.remarks = {trouble};
  }
  report_.notes = scene_.remarks;
  return scene_.remarks;
}

std::string OpenBracket::arrived(const BracketFrame& frame, int index, bool last) {
  ++report_.frames_seen;
  const Frame arrived{index, frame.image, focusOf(frame, index)};
  if (last || index >= wanted_reference_) holding_ = false;
  if (holding_) {
    try {
      const cv_bridge::CvImageConstPtr bgr = toBgr(frame.image);
      const Stopwatch watch;
      fusion_.observe(bgr->image, index, arrived.focus_mm);
      fusion_ms_ += watch.milliseconds();
    } catch (const std::exception& e) {
      return reject(index, e.what());
    }
  }
  waiting_.push_back(arrived);
  return "";
}

bool OpenBracket::fuseNext(FusedFrame& fused) {
  if (waiting_.empty() || holding_) return false;
  auto next = waiting_.begin();
  if (mode_ == Mode::kRefined && report_.frames_used == 0) {
    next = std::min_element(waiting_.begin(), waiting_.end(), [this](const Frame& a, const Frame& b) {
      return nearerToReference(a.index, b.index);
    });
  }
  const Frame frame = *next;
  waiting_.erase(next);
  fused = {frame.index, frame.image, ""};
  try {
    const cv_bridge::CvImageConstPtr bgr = toBgr(frame.image);
    const Stopwatch watch;
    const std::string misfit = fusion_.add(bgr->image, frame.index, frame.focus_mm);
    fusion_ms_ += watch.milliseconds();
    if (misfit.empty()) {
      used(frame);
    } else {
      fused.trouble = "frame " + std::to_string(frame.index) + ": " + reject(frame.index, misfit);
    }
  } catch (const std::exception& e) {
    fused.trouble = reject(frame.index, e.what());
  }
  return true;
}

// Mode paper keeps no geometry: there the nearest of all frames gives its stamp.
void OpenBracket::used(const Frame& frame) {
  const bool is_first = report_.frames_used++ == 0;
  const int reference = static_cast<int>(report_.reference);
  if (!is_first && (mode_ == Mode::kRefined || !nearerToReference(frame.index, reference))) return;
  report_.reference = static_cast<std::uint32_t>(frame.index);
  report_.header = frame.image->header;
  if (mode_ == Mode::kRefined && frame.index != wanted_reference_) {
    note("the reference, frame " + std::to_string(wanted_reference_) + ", cannot be had: frame " +
         std::to_string(frame.index) + " stands in");
  }
}

bool OpenBracket::nearerToReference(int index, int than) const {
  return std::abs(index - wanted_reference_) < std::abs(than - wanted_reference_);
}

// NaN where it is unknown or impossible.
double OpenBracket::focusOf(const BracketFrame& frame, int index) {
  if (!frame.focus || std::isnan(frame.focus->focus_distance)) return BracketFusion::kUnknownFocus;
  const double focus_mm = frame.focus->focus_distance * kMmPerM;
  if (focus_mm > scene_.scene.optics.focal_length_mm) {
    focus_known_ = true;
    return focus_mm;
  }
  if (mode_ == Mode::kRefined && !focus_refused_) {
    focus_refused_ = true;
    note(cv::format("frame %d: a lens of %g mm cannot be focused at %g m: such focus distances are unknown",
                    index, scene_.scene.optics.focal_length_mm, frame.focus->focus_distance));
  }
  return BracketFusion::kUnknownFocus;
}

std::string OpenBracket::reject(int index, const std::string& reason) {
  ++report_.frames_rejected;
  note("frame " + std::to_string(index) + " rejected: " + reason);
  return reason;
}

void OpenBracket::note(const std::string& text) {
  if (report_.notes.size() < kMaxNotes) report_.notes.push_back(text);
}

FusedBracket OpenBracket::fused(int missing) {
  const Stopwatch watch;
  FusedBracket bracket;
  if (report_.frames_used > 0) bracket.result = fusion_.result();
  fusion_ms_ += watch.milliseconds();

  bracket.report = boost::make_shared<FusionReport>(report_);
  FusionReport& report = *bracket.report;
  report.mode = name(fusion_.fusedBy());
  report.frames_missing = static_cast<std::uint32_t>(missing);
  for (const RegionChoice& choice : bracket.result.regions) {
    SegmentChoice message;
    message.label = static_cast<std::uint32_t>(choice.label);
    message.frame = static_cast<std::uint16_t>(choice.frame);
    message.score = choice.score;
    message.margin = choice.margin;
    message.confidence = choice.confidence;
    report.segments.push_back(message);
  }
  if (!scene_.scene.depth.empty() && scene_.scene.camera && !focus_known_) {
    report.notes.insert(report.notes.begin() + static_cast<std::ptrdiff_t>(scene_.remarks.size()),
                        "no focus distances: depth and optics have no say in the fusion");
  }
  report.notes.insert(report.notes.end(), bracket.result.notes.begin(), bracket.result.notes.end());
  report.timing_names = {"label_wait", "fusion"};
  report.timing_ms = {label_wait_ms_, fusion_ms_};
  return bracket;
}

}  // namespace all_in_focus
