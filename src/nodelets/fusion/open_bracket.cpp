// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "open_bracket.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdlib>
#include <stdexcept>

#include "image_limit.hpp"
#include "stopwatch.hpp"

namespace all_in_focus {
namespace {

constexpr std::size_t kMaxNotes = 20;  // of one report, before those of the result
constexpr double kMmPerM = 1000;
constexpr const char* kDepthTopic = "depth_registered/image";
constexpr const char* kMeasuredTopic = "depth_registered/image_raw";
constexpr const char* kCameraTopic = "rgb/camera_info";
constexpr const char* kColourTopic = "rgb/image";
constexpr const char* kNoSay = ": depth and optics have no say in the fusion";

std::string missing(const char* topic) {
  return std::string("no ") + topic + " in time";
}

void takeDepth(const SceneMessages& messages, SharedScene& shared) {
  if (!messages.depth) throw std::invalid_argument(missing(kDepthTopic));
  shared.depth = toDepth(messages.depth, {}, kDepthTopic);
  shared.scene.depth = shared.depth.mm;
}

void takeMeasured(const SceneMessages& messages, SharedScene& shared) {
  if (!messages.measured) throw std::invalid_argument(missing(kMeasuredTopic));
  shared.measured = toDepth(messages.measured, {}, kMeasuredTopic);
  if (shared.measured.mm.size() != shared.depth.mm.size())
    throw std::invalid_argument(std::string(kMeasuredTopic) + " is not of the size of " + kDepthTopic);
  shared.scene.measured = shared.measured.mm;
}

void takeCamera(const SceneMessages& messages, SharedScene& shared) {
  shared.scene.optics = toOptics(messages.labels.segments->optics);
  if (!messages.camera) throw std::invalid_argument(missing(kCameraTopic));
  const Camera camera = toCamera(*messages.camera, kCameraTopic);
  requireRegion(*messages.camera, messages.frame_size, kCameraTopic);
  // The sensor does not change with the lens: a zoom leaves its pixels as they are.
  shared.scene.pixel_pitch_mm = messages.focal_length_mm / camera.fx;
  shared.scene.camera = camera;
}

}  // namespace

SharedScene toScene(const SceneMessages& messages, Mode mode) {
  SharedScene shared;
  if (!messages.labels.labels) return shared;
  shared.labels = cv_bridge::toCvShare(messages.labels.labels, sensor_msgs::image_encodings::TYPE_32SC1);
  shared.scene.labels = shared.labels->image;
  if (mode == Mode::kPaper) return shared;

  const auto attempt = [&](auto take, const char* consequence) {
    try {
      take(messages, shared);
      return true;
    } catch (const std::exception& e) {
      shared.warnings.push_back(oneLine(e.what()) + consequence);
      return false;
    }
  };
  if (attempt(takeDepth, kNoSay)) attempt(takeMeasured, ": filled depth counts as measured");
  attempt(takeCamera, kNoSay);
  return shared;
}

void FusedBracket::setRestored(const RestorationResult& restored, double took_ms) {
  result.image = restored.image;
  restored_depth = restored.depth;
  report->mode = name(FusedBy::kRestored);
  report->blur_scale = restored.blur_scale;
  report->notes.insert(report->notes.end(), restored.notes.begin(), restored.notes.end());
  report->timing_names.push_back("restoration");
  report->timing_ms.push_back(took_ms);
}

// The scene uses the memory of the messages, so they must live as long as it.
struct OpenBracket::Restoration {
  SharedScene scene;
  BracketRestoration restoration;
};

OpenBracket::OpenBracket(const FusionTask& first, const FusionSettings& settings, BracketFusion& fusion)
    : settings_(settings),
      fusion_(fusion),
      depth_stamp_(first.header.stamp),
      reference_(plannedReference(first)),
      order_(settings.mode, reference_) {
  report_.header = first.header;
  report_.bracket_id = first.step.bracket_id;
  report_.mode = name(FusedBy::kSharpness);
  if (settings.mode == Mode::kRestored && settings.sliding) {
    note("not restored: bracket_mode sliding publishes what is refined");
  } else if (settings.mode == Mode::kRestored) {
    restoration_ = std::make_shared<Restoration>();
    fusion_.handAlignedFramesTo(
        [to = restoration_](const AlignedFrame& frame) { to->restoration.add(frame); });
  }
}

OpenBracket::~OpenBracket() {
  fusion_.handAlignedFramesTo({});
}

void OpenBracket::begin(const BracketScene& scene) {
  fusion_.begin(scene, settings_.mode);
  if (!restoration_) return;
  restoration_->scene = scene_;
  restoration_->restoration.begin(scene);
}

// Adds a note if this is not the wanted one.
int OpenBracket::plannedReference(const FusionTask& first) {
  const int length = first.step.length, first_index = first.step.index;
  int reference = settings_.reference >= 0 ? settings_.reference : length / 2;
  if (length > 0) reference = std::min(reference, length - 1);
  if (settings_.mode == Mode::kPaper || reference <= first_index) return reference;

  const std::string instead = ": the first frame is the reference, not frame " + std::to_string(reference);
  const auto held = static_cast<std::size_t>(reference - first_index);
  const std::size_t most = imageLimit(settings_.max_held_frames, first.bytes);
  if (settings_.sliding) {
    note("bracket_mode sliding" + instead);
  } else if (held > most) {
    note("at most " + std::to_string(most) + " frames are held (max_held_frames, memory)" + instead);
  } else {
    return reference;
  }
  return first_index;
}

std::vector<std::string> OpenBracket::setScene(const SceneMessages& messages, double waited_ms) {
  has_scene_ = true;
  scene_wait_ms_ = waited_ms;
  depth_ = messages.depth;
  if (messages.labels.labels) depth_stamp_ = messages.labels.labels->header.stamp;
  std::string error;
  if (!messages.labels.labels) {
    error = "no label image in time for the bracket: fused by sharpness alone: " + messages.no_labels;
  }
  try {
    scene_ = toScene(messages, settings_.mode);
    begin(scene_.scene);
  } catch (const std::exception& e) {
    error = "label image refused, fused by sharpness alone: " + oneLine(e.what());
    scene_ = {};
    begin({});
  }
  report_.has_labels = error.empty();
  if (report_.has_labels) {
    report_.label_stamp = messages.labels.labels->header.stamp;
    report_.optics = messages.labels.segments->optics;
  } else {
    scene_.warnings = {error};
  }
  report_.notes.insert(report_.notes.begin(), scene_.warnings.begin(), scene_.warnings.end());
  return scene_.warnings;
}

FrameFates OpenBracket::add(const FusionTask& task, const Interrupted& interrupted) {
  const int index = task.step.index;
  length_ = std::max({length_, task.step.length, index + 1});
  missing_ = task.step.missing;
  if (!task.frame.image) {
    ++dropped_;
    return {};
  }
  ++report_.frames_seen;
  const Frame frame{task.frame.image, focusOf(task.frame, index)};
  order_.arrived(index, task.step.last);
  waiting_[index] = frame;
  if (order_.isHolding()) {
    try {
      const cv_bridge::CvImageConstPtr bgr = toBgr(frame.image, kColourTopic);
      const Stopwatch watch;
      fusion_.observe(bgr->image, index, frame.focus_mm);
      fusion_ms_ += watch.milliseconds();
      return {{frame.image->header, FrameFate::Kind::kHeld, ""}};
    } catch (const std::exception& e) {
      order_.done(index, false);
      waiting_.erase(index);
      return {{frame.image->header, FrameFate::Kind::kRejected, reject(index, e.what())}};
    }
  }
  return fuseReady(interrupted);
}

FrameFates OpenBracket::close(int missing, const Interrupted& interrupted) {
  missing_ = missing;
  order_.close();
  return fuseReady(interrupted);
}

FrameFates OpenBracket::fuseReady(const Interrupted& interrupted) {
  FrameFates fates;
  while (const std::optional<int> index = order_.next()) {
    if (interrupted()) break;
    const Frame frame = waiting_.at(*index);
    waiting_.erase(*index);
    const std::string rejection = fuse(*index, frame);
    order_.done(*index, rejection.empty());
    const auto kind = rejection.empty() ? FrameFate::Kind::kUsed : FrameFate::Kind::kRejected;
    fates.push_back({frame.image->header, kind, rejection});
  }
  return fates;
}

// Returns why the frame was rejected, or "".
std::string OpenBracket::fuse(int index, const Frame& frame) {
  try {
    const cv_bridge::CvImageConstPtr bgr = toBgr(frame.image, kColourTopic);
    const Stopwatch watch;
    const std::string rejection = fusion_.add(bgr->image, index, frame.focus_mm);
    fusion_ms_ += watch.milliseconds();
    if (!rejection.empty()) return "frame " + std::to_string(index) + ": " + reject(index, rejection);
    used(index, frame);
    return "";
  } catch (const std::exception& e) {
    return reject(index, e.what());
  }
}

// Mode paper keeps no geometry: there the nearest of all frames gives its stamp.
void OpenBracket::used(int index, const Frame& frame) {
  const auto distance = [this](int to) { return std::abs(to - reference_); };
  const bool is_first = report_.frames_used++ == 0;
  const bool is_paper = settings_.mode == Mode::kPaper;
  const int reference = static_cast<int>(report_.reference);
  if (!is_first && !(is_paper && distance(index) < distance(reference))) return;
  report_.reference = static_cast<std::uint32_t>(index);
  report_.header = frame.image->header;
  if (!is_paper && index != reference_) {
    note("the reference, frame " + std::to_string(reference_) + ", is missing or was rejected: frame " +
         std::to_string(index) + " takes its place");
  }
}

// NaN if it is unknown or impossible.
double OpenBracket::focusOf(const BracketFrame& frame, int index) {
  if (!frame.focus || std::isnan(frame.focus->focus_distance)) return BracketFusion::kUnknownFocus;
  const double focus_mm = frame.focus->focus_distance * kMmPerM;
  if (focus_mm > scene_.scene.optics.focal_length_mm) {
    focus_known_ = true;
    return focus_mm;
  }
  if (settings_.mode != Mode::kPaper && !focus_refused_) {
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
  if (report_.notes.size() < kMaxNotes) report_.notes.push_back(oneLine(text));
}

FusedBracket OpenBracket::fused(bool complete) const {
  const Stopwatch watch;
  FusedBracket bracket;
  if (report_.frames_used > 0) bracket.result = fusion_.result();
  const double result_ms = watch.milliseconds();
  bracket.frames = length_;
  bracket.depth = depth_;

  bracket.report = boost::make_shared<FusionReport>(report_);
  FusionReport& report = *bracket.report;
  if (has_scene_) report.mode = name(fusion_.fusedBy());
  report.frames_missing = static_cast<std::uint32_t>(missing_ + dropped_);
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
    report.notes.insert(report.notes.begin() + static_cast<std::ptrdiff_t>(scene_.warnings.size()),
                        "no focus distances: depth and optics have no say in the fusion");
  }
  report.notes.insert(report.notes.end(), bracket.result.notes.begin(), bracket.result.notes.end());
  if (restoration_ && report_.frames_used > 0) {
    const std::string missing = restoration_->restoration.missing();
    if (missing.empty()) {
      bracket.restoration = {restoration_, &restoration_->restoration};
    } else {
      report.notes.push_back("not restored: " + missing);
    }
  }
  if (report_.frames_used == 0) bracket.warnings.push_back("no frame could be used: nothing to publish");
  if (report_.frames_used == 1 && complete)
    bracket.warnings.push_back("only one frame: the result is that frame");
  if (missing_ > 0) bracket.warnings.push_back(std::to_string(missing_) + " frames never came");
  if (dropped_ > 0) {
    bracket.warnings.push_back(std::to_string(dropped_) +
                               " frames were dropped: the fusion could not keep up");
  }
  report.notes.insert(report.notes.end(), bracket.warnings.begin(), bracket.warnings.end());
  report.timing_names = {"label_wait", "fusion"};
  report.timing_ms = {scene_wait_ms_, fusion_ms_ + result_ms};
  return bracket;
}

}  // namespace all_in_focus
