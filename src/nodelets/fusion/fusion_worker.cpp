// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_worker.hpp"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/rig_checks.hpp"
#include "image_limit.hpp"
#include "time_jumps.hpp"
#include "topics.hpp"

namespace all_in_focus {
namespace {

constexpr double kIdlePeriod = 0.05;              // s, between checks for a gap in time
constexpr int kSilence = 10;                      // s of wall time, in an open bracket, before a warning
constexpr const char* kProgress = "restoration";  // key of the diagnostics

Outcome outcomeOf(const FrameStatus& status) {
  return status.kind == FrameStatus::Kind::kRejected ? Outcome::kInvalid : Outcome::kProcessed;
}

std::string reasonOf(const FrameStatus& status) {
  return status.reason.empty() ? "" : "frame " + std::to_string(status.index) + ": " + status.reason;
}

// Likely mistakes in optics or depth, one line each, in the words of fuse_stack.
std::vector<std::string> checkRig(const FusionReport& report, const SharedScene& scene,
                                  const cv::Mat& image) {
  std::vector<std::string> warnings;
  try {
    if (report.optics.focal_length_mm > 0 && scene.messages.camera) {
      warnings.push_back(core::checkCircleOfConfusion(toOptics(report.optics),
                                                      toCamera(*scene.messages.camera, topics::kColorInfo)));
    }
    warnings.push_back(core::checkMirroring(scene.scene.depth, cv::Mat(), image));
  } catch (const std::invalid_argument&) {
    // Reported where it is used.
  }
  warnings.erase(std::remove(warnings.begin(), warnings.end(), std::string()), warnings.end());
  return warnings;
}

}  // namespace

/// The bracket being fused. Its images and its scene live as long as `bracket_` uses them.
struct FusionWorker::OpenBracket {
  struct Frame {
    ros::Time stamp;
    double focus_mm = kUnknownFocus;
    sensor_msgs::ImageConstPtr image;  // while it is held
    bool acknowledged = false;         // early
  };
  FusionSettings settings;
  FocusFrame first;  // which frame came first
  SharedScene scene;
  std::map<int, Frame> frames;  // by index
  int white = 0;                // its code in frames with 16 bits; 0: none has come
  int missing = 0, dropped = 0;
  double scene_wait_ms = 0;
};

FusionWorker::FusionWorker(CallbackGuard& guard, NodeStatus& status, SceneCache& scenes,
                           FusionOutputs& outputs)
    : guard_(guard), status_(status), scenes_(scenes), outputs_(outputs) {
  const auto on_timer = guard.wrap([this](const ros::WallTimerEvent&) { onTimer(); });
  timer_ = guard.slow.nh.createWallTimer(ros::WallDuration(kIdlePeriod), on_timer);
}

FusionWorker::~FusionWorker() = default;

void FusionWorker::configure(const FusionSettings& settings) {
  std::lock_guard<std::mutex> lock(mutex_);
  settings_ = settings;
  assembler_.configure(settings.ends);
}

void FusionWorker::announce(const FocusFrame& focus) {
  if (focus.index != 0) return;
  std::lock_guard<std::mutex> lock(mutex_);
  assembler_.announce(focus.bracket_id);
  scenes_.pin(focus.header.stamp);
}

void FusionWorker::add(const BracketFrame& frame) {
  const std_msgs::Header& header = frame.image->header;
  std::lock_guard<std::mutex> lock(mutex_);
  if (assembler_.endsBefore(frame)) endBracket();
  last_frame_ = ros::Time::now();
  silent_since_ = ros::WallTime::now();
  const BracketAssembler::Step step = assembler_.add(frame);
  if (!step.use) return status_.acknowledge(header, Outcome::kUnmatched, step.reason);
  if (step.begin) scenes_.pin(header.stamp);  // before the worker asks for the scene
  outputs_.tell(step.frame);                  // before the result
  push({step, frame.image});
  limit_ = imageLimit(settings_.most_waiting, *frame.image);
  dropWholeBrackets(imageLimit(settings_.most_waiting, *frame.image, kMaxWaitingBytes / 4));
  const auto waits = [](const Task& task) { return task.image != nullptr; };
  while (waitingImages() > limit_) drop(*std::find_if(tasks_.begin(), tasks_.end(), waits));
}

// Holds mutex_. The oldest ones of which no frame has been handled, but never the newest one: a few whole
// brackets are worth more than a few frames of each.
void FusionWorker::dropWholeBrackets(std::size_t most) {
  const auto begins = [](const Task& task) { return task.step.begin; };
  auto next = std::find_if(tasks_.begin(), tasks_.end(), begins);
  while (next != tasks_.end() && waitingImages() > most) {
    const auto first = next;
    next = std::find_if(std::next(first), tasks_.end(), begins);
    if (next == tasks_.end()) return;
    std::for_each(first, next, [this](Task& task) { drop(task); });
  }
}

// Holds mutex_.
void FusionWorker::drop(Task& task) {
  if (!task.image) return;
  status_.acknowledge(task.image->header, Outcome::kDropped,
                      "fusion cannot keep up: oldest waiting colour frames dropped");
  task.image.reset();
}

// Holds mutex_.
void FusionWorker::push(const Task& task) {
  tasks_.push_back(task);
  guard_.post([this] { handleNext(); });
}

// Holds mutex_.
std::size_t FusionWorker::waitingImages() const {
  return std::count_if(tasks_.begin(), tasks_.end(), [](const Task& task) { return task.image != nullptr; });
}

// Holds mutex_.
void FusionWorker::endBracket() {
  if (!assembler_.open()) return;
  BracketAssembler::Step end;
  end.frame.last = true;
  end.missing = assembler_.close();
  push({end, nullptr});
}

void FusionWorker::restart() {
  std::lock_guard<std::mutex> lock(mutex_);
  endBracket();
  assembler_.restart();
}

void FusionWorker::cancel() {
  std::lock_guard<std::mutex> lock(mutex_);
  tasks_.clear();
  assembler_.restart();
  is_cancelled_ = true;
  guard_.post([this] { handleNext(); });
}

int FusionWorker::finish() {
  std::size_t waiting = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    endBracket();
    waiting = tasks_.size();
  }
  for (; waiting > 0 && !is_cancelled_; --waiting) handleNext();
  return is_cancelled_ ? -1 : published_;
}

bool FusionWorker::mayRestore(double done) const {
  const std::string id = std::to_string(open_->first.bracket_id);
  status_.setValue(kProgress, "bracket " + id + ": " + std::to_string(std::lround(100 * done)) + " %");
  if (is_cancelled_) return false;
  if (open_->settings.restore_every) return true;
  std::lock_guard<std::mutex> lock(mutex_);
  const auto is_last = [](const Task& task) { return task.step.frame.last; };
  const bool is_whole = std::any_of(tasks_.begin(), tasks_.end(), is_last);
  return !is_whole && 2 * waitingImages() <= limit_;
}

void FusionWorker::handleNext() {
  Task task;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (is_cancelled_.exchange(false)) open_.reset();
    if (tasks_.empty()) return;  // ~finish was first, or all were cancelled
    task = std::move(tasks_.front());
    tasks_.pop_front();
  }
  try {
    handle(task);
  } catch (const std::exception& e) {
    open_.reset();  // what it holds is uncertain
    status_.error(std::string("fusion: ") + e.what());
    if (task.image) status_.acknowledge(task.step.frame.header, Outcome::kInvalid, e.what());
  }
}

// Ends a bracket after its gap in time, unless frames wait that may belong to it. A bracket of rgb/focus has
// no gap: it is warned of after a long pause, also while /clock stands still because a bag is at its end.
void FusionWorker::onTimer() {
  std::lock_guard<std::mutex> lock(mutex_);
  if (!tasks_.empty() || !assembler_.open()) return;
  if (ros::Time::isValid() && assembler_.endsAfter(secondsBetween(last_frame_, ros::Time::now())))
    return endBracket();
  if (!assembler_.byFocus() || (ros::WallTime::now() - silent_since_).toSec() < kSilence) return;
  status_.warn("bracket " + std::to_string(assembler_.id()) + " is open and no frame has come for " +
               std::to_string(kSilence) + " s: ~finish or the next bracket ends it");
}

void FusionWorker::handle(const Task& task) {
  const FocusFrame& frame = task.step.frame;
  if (task.step.begin) open(frame);
  if (!open_) {
    if (task.image) status_.acknowledge(frame.header, Outcome::kUnmatched, "its bracket was given up");
    return;
  }
  open_->missing = task.step.missing;
  if (!task.image) {
    if (task.step.use) ++open_->dropped;
    if (frame.last) finishBracket();
    return;
  }
  if (open_->frames.empty()) awaitScene(frame, *task.image);
  FrameStatus status = fuse(task);
  if (frame.last) {
    status = finishBracket().back();
  } else if (status.kind == FrameStatus::Kind::kHeld) {
    open_->frames.at(status.index).acknowledged = true;
    return status_.acknowledgeEarly(frame.header);
  } else if (open_->settings.bracket.sliding && status.kind == FrameStatus::Kind::kUsed) {
    joinScene();
    publish(bracket_.preview(), /*complete=*/false);
  }
  // Whoever gets the acknowledgement of a frame may rely on its result.
  status_.acknowledge(frame.header, outcomeOf(status), reasonOf(status));
}

void FusionWorker::open(const FocusFrame& first) {
  open_ = std::make_unique<OpenBracket>();
  open_->first = first;
  bracket_.begin({}, {}, {});
  std::lock_guard<std::mutex> lock(mutex_);
  open_->settings = settings_;
}

// first, image: those of the first frame whose image was not dropped.
void FusionWorker::awaitScene(const FocusFrame& first, const sensor_msgs::Image& image) {
  FusionSettings& settings = open_->settings;
  const ros::WallTime start = ros::WallTime::now();
  const SceneMessages messages = scenes_.await(open_->first.header.stamp, settings.label_timeout_s);
  open_->scene_wait_ms = (ros::WallTime::now() - start).toSec() * 1e3;
  const cv::Size size(static_cast<int>(image.width), static_cast<int>(image.height));
  open_->scene = toScene(messages, settings.bracket.mode, size, settings.calibration);
  const bool is_paper = settings.bracket.mode == Mode::kPaper;
  if (!(is_paper ? messages.labels : messages.depth)) {
    open_->scene.warnings.push_back(
        std::string("no ") + (is_paper ? "label image" : topics::kDepth) +
        " in time for the bracket: fused by sharpness alone: " + scenes_.whyNone(open_->first.header.stamp));
  }
  for (const std::string& warning : open_->scene.warnings) status_.warn(warning);

  settings.bracket.length = static_cast<int>(std::max(first.count, first.index + 1));
  settings.bracket.max_held = static_cast<int>(imageLimit(settings.bracket.max_held, image));
  beginBracket();
}

void FusionWorker::beginBracket() {
  bracket_.begin(open_->scene.scene, open_->settings.bracket, [this](int index) {
    return inFullRange(toBgr(open_->frames.at(index).image, topics::kImage)->image);
  });
}

FrameStatus FusionWorker::fuse(const Task& task) {
  const auto index = static_cast<int>(task.step.frame.index);
  OpenBracket::Frame& frame = open_->frames[index];
  frame.stamp = task.step.frame.header.stamp;
  frame.focus_mm = task.step.frame.focus_distance * kMmPerM;
  cv::Mat bgr;
  try {
    bgr = toBgr(task.image, topics::kImage)->image;
  } catch (const std::exception& e) {
    return bracket_.reject(index, e.what());
  }
  frame.image = task.image;
  findWhite(bgr);
  FrameStatus status = bracket_.add(inFullRange(bgr), index, frame.focus_mm);
  releaseFrames();
  return status;
}

// Those that the bracket will not ask for again.
void FusionWorker::releaseFrames() {
  for (auto& [index, frame] : open_->frames) {
    if (!bracket_.holds(index)) frame.image.reset();
  }
}

// Cameras may use fewer than 16 bits. Which code is white is found anew in each bracket, whose frames must be
// scaled alike: while none is fused, a higher code than before scales all of them again.
void FusionWorker::findWhite(const cv::Mat& bgr) {
  if (bgr.depth() != CV_16U) return;
  double highest = 0;
  cv::minMaxLoc(bgr.reshape(1), nullptr, &highest);
  const int white = core::whiteCode(static_cast<int>(highest)), before = open_->white;
  open_->white = std::max(before, white);
  if (before == 0 || white <= before) return;
  const BracketResult so_far = bracket_.preview();
  if (so_far.used > 0) return;
  beginBracket();
  for (const FrameStatus& frame : so_far.frames) {
    const OpenBracket::Frame& held = open_->frames.at(frame.index);
    held.image
        ? bracket_.add(inFullRange(toBgr(held.image, topics::kImage)->image), frame.index, held.focus_mm)
        : bracket_.reject(frame.index, frame.reason);
  }
}

// The picture with 65535 for white, if it has 16 bits.
cv::Mat FusionWorker::inFullRange(const cv::Mat& bgr) const {
  if (bgr.depth() != CV_16U || open_->white == 65535) return bgr;
  cv::Mat scaled;
  bgr.convertTo(scaled, CV_16U, 65535.0 / open_->white);
  return scaled;
}

// Images that have the stamp of the scene may come after its depth. Where all frames were dropped, nobody has
// asked for a scene: the one at work is that of another bracket.
void FusionWorker::joinScene() {
  if (open_->frames.empty()) return;
  const bool has_new_labels = joinLate(scenes_.current(), open_->scene);
  if (has_new_labels && open_->settings.bracket.mode != Mode::kPaper)
    bracket_.setLabels(open_->scene.scene.labels);
}

// Returns what has become of all frames.
std::vector<FrameStatus> FusionWorker::finishBracket() {
  joinScene();
  BracketResult result = bracket_.finish([this](double done) {
    releaseFrames();  // restoration needs memory
    return mayRestore(done);
  });
  status_.setValue(kProgress, "idle");
  releaseFrames();
  if (result.stopped) result.warnings.emplace_back("not restored: the next bracket came first");
  if (!is_cancelled_) publish(result, /*complete=*/true);
  for (const FrameStatus& frame : result.frames) {
    if (!open_->frames.at(frame.index).acknowledged) continue;
    status_.count(outcomeOf(frame));
    if (!frame.reason.empty()) status_.error(reasonOf(frame));
  }
  open_.reset();
  return result.frames;
}

void FusionWorker::publish(const BracketResult& result, bool complete) {
  const FusionReportPtr report = toReport(result);
  const int length = std::max(result.length, static_cast<int>(report->frames_seen + report->frames_missing));
  std::vector<std::string> warnings = result.warnings;
  if (result.used == 0) warnings.emplace_back("no frame could be used: nothing to publish");
  if (complete && result.used > 0 && 2 * result.used < length) {
    warnings.push_back("only " + std::to_string(result.used) + " of " + std::to_string(length) +
                       " frames were used, see the notes of the report");
  }
  if (result.used == 1 && complete) warnings.emplace_back("only one frame: the result is that frame");
  if (open_->missing > 0) warnings.push_back(std::to_string(open_->missing) + " frames never came");
  if (open_->dropped > 0)
    warnings.push_back(std::to_string(open_->dropped) + " frames were dropped: the fusion could not keep up");
  if (complete) {
    for (const std::string& warning : checkRig(*report, open_->scene, core::toEightBits(result.image)))
      warnings.push_back(warning);
    for (const std::string& warning : warnings)
      status_.warn("bracket " + std::to_string(open_->first.bracket_id) + ": " + warning);
    ++published_;
  }
  const auto append = [&notes = report->notes](const auto& lines) {
    notes.insert(notes.end(), lines.begin(), lines.end());
  };
  append(open_->scene.warnings);
  if (open_->white > 0 && open_->white < 65535)
    report->notes.push_back("frames with 16 bits: code " + std::to_string(open_->white) + " is white");
  append(result.notes);
  append(warnings);
  outputs_.publish(result, report, open_->scene);
}

// All but the notes.
FusionReportPtr FusionWorker::toReport(const BracketResult& result) const {
  auto report = boost::make_shared<FusionReport>();
  report->header = open_->first.header;
  if (result.used > 0) report->header.stamp = open_->frames.at(result.reference).stamp;
  report->bracket_id = open_->first.bracket_id;
  report->mode = name(result.mode);
  report->sharpness_alone = result.sharpness_alone;
  report->frames_seen = static_cast<std::uint32_t>(result.frames.size());
  report->frames_used = static_cast<std::uint32_t>(result.used);
  report->frames_rejected = static_cast<std::uint32_t>(result.rejected);
  report->frames_missing = static_cast<std::uint32_t>(open_->missing + open_->dropped);
  report->reference = static_cast<std::uint32_t>(result.reference);
  report->has_labels = result.has_labels;
  if (result.has_labels) report->label_stamp = open_->scene.messages.labels->header.stamp;
  if (open_->scene.scene.camera) {
    report->optics = toMessage(open_->scene.scene.optics);
  } else if (result.has_labels && open_->scene.messages.optics) {
    report->optics = *open_->scene.messages.optics;
  }
  report->blur_scale = result.blur_scale;
  for (const RegionChoice& choice : result.regions) {
    SegmentChoice message;
    message.label = static_cast<std::uint32_t>(choice.label);
    message.frame = static_cast<std::uint16_t>(choice.frame);
    message.score = choice.score;
    message.margin = choice.margin;
    message.confidence = choice.confidence;
    report->segments.push_back(message);
  }
  report->timing_names = {"scene_wait", "fusion"};
  report->timing_ms = {open_->scene_wait_ms, result.fusion_ms};
  if (result.mode == Mode::kRestored) {
    report->timing_names.emplace_back("restoration");
    report->timing_ms.push_back(result.restoration_ms);
  }
  return report;
}

}  // namespace all_in_focus
