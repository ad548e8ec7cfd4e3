// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_worker.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "all_in_focus/rig_checks.hpp"
#include "stopwatch.hpp"

namespace all_in_focus {
namespace {

// Likely mistakes in optics or depth, one line each, in the words of fuse_stack.
std::vector<std::string> checkRig(const FusedBracket& bracket) {
  std::vector<std::string> warnings;
  try {
    const core::Optics optics = toOptics(bracket.report->optics);
    if (bracket.report->has_labels && bracket.camera)
      warnings.push_back(core::checkCircleOfConfusion(optics, toCamera(*bracket.camera, "rgb/camera_info")));
    if (bracket.depth && !bracket.result.image.empty()) {
      const DepthImage depth = toDepth(bracket.depth, {}, "depth_registered/image");
      warnings.push_back(core::checkMirroring(depth.mm, cv::Mat(), bracket.result.image));
    }
  } catch (const std::invalid_argument&) {
    // Reported where it is used.
  }
  warnings.erase(std::remove(warnings.begin(), warnings.end(), std::string()), warnings.end());
  return warnings;
}

}  // namespace

FusionWorker::FusionWorker(NodeStatus& status, FrameQueue& queue, SceneCache& scenes, Publish publish)
    : status_(status),
      queue_(queue),
      scenes_(scenes),
      publish_(std::move(publish)),
      restorer_(
          status, [this] { return queue_.interrupted(); },
          [this](const FusedBracket& bracket, const FrameFates& fates) {
            publish_(bracket);
            acknowledge(fates);
          }),
      thread_([this] { run(); }) {}

FusionWorker::~FusionWorker() {
  queue_.stop();
  scenes_.close();
  thread_.join();
}

void FusionWorker::configure(const FusionSettings& settings) {
  scenes_.setMaxAge(settings.label_max_age_s);
  std::lock_guard<std::mutex> lock(mutex_);
  settings_ = settings;
}

FusionSettings FusionWorker::settings() {
  std::lock_guard<std::mutex> lock(mutex_);
  return settings_;
}

void FusionWorker::run() {
  while (!queue_.stopped()) {
    const std::optional<FusionTask> task = queue_.take();
    if (!task) continue;
    restorer_.setPaused(true);
    try {
      handle(*task);
    } catch (const std::exception& e) {
      bracket_.reset();  // what it holds is uncertain
      status_.error(std::string("fusion: ") + e.what());
      if (task->frame.image) status_.acknowledge(task->header, Outcome::kInvalid, e.what());
    }
    restorer_.setPaused(false);
    if (settings().restore_every) restorer_.wait();
    if (task->finished)
      restorer_.whenIdle([finished = task->finished, count = published_] { finished->set_value(count); });
  }
}

void FusionWorker::handle(const FusionTask& task) {
  if (task.kind == FusionTask::Kind::kFrame) handleFrame(task);
  if (task.kind == FusionTask::Kind::kEnd) endBracket(task.missing);
  if (task.kind == FusionTask::Kind::kAbandon) {
    bracket_.reset();
    restorer_.drop();
  }
}

void FusionWorker::handleFrame(const FusionTask& task) {
  if (task.step.begin) bracket_ = std::make_unique<OpenBracket>(task, settings(), fusion_);
  if (!bracket_) {
    if (task.frame.image) status_.acknowledge(task.header, Outcome::kUnmatched, "its bracket was given up");
    return;
  }
  if (task.frame.image && !bracket_->hasScene()) findScene(*task.frame.image);
  const FrameFates fates = bracket_->add(task, [this] { return queue_.interrupted(); });
  const auto is_used = [](const FrameFate& fate) { return fate.kind == FrameFate::Kind::kUsed; };
  if (task.step.last) {
    endBracket(task.step.missing);
  } else if (bracket_->settings().sliding && std::any_of(fates.begin(), fates.end(), is_used)) {
    publish_(fused(/*complete=*/false));
  }
  acknowledge(fates);  // comes last: whoever gets the acknowledgement of a frame may rely on its result
}

void FusionWorker::findScene(const sensor_msgs::Image& first_frame) {
  const FusionSettings& settings = bracket_->settings();
  const Stopwatch watch;
  SceneMessages scene =
      scenes_.await(first_frame.header.stamp, settings.label_max_age_s, settings.label_timeout_s,
                    /*whole=*/settings.mode != Mode::kPaper);
  scene.frame_size = cv::Size(static_cast<int>(first_frame.width), static_cast<int>(first_frame.height));
  for (const std::string& warning : bracket_->setScene(scene, watch.milliseconds())) status_.warn(warning);
}

void FusionWorker::endBracket(int missing) {
  if (!bracket_) return;
  const FrameFates fates = bracket_->close(missing, [this] { return queue_.interrupted(); });
  restorer_.giveUp("the next bracket was fused first");
  if (!queue_.interrupted()) {
    const FusedBracket bracket = fused(/*complete=*/true);
    bracket_.reset();
    if (bracket.restoration) return restorer_.start(bracket, fates);
    publish_(bracket);
  }
  bracket_.reset();
  acknowledge(fates);
}

FusedBracket FusionWorker::fused(bool complete) {
  FusedBracket bracket = bracket_->fused(complete);
  if (!bracket.depth) bracket.depth = scenes_.depthAt(bracket_->depthStamp());  // labels may come first
  bracket.camera = scenes_.camera();
  const std::string id = "bracket " + std::to_string(bracket.report->bracket_id) + ": ";
  if (complete) {
    for (const std::string& warning : checkRig(bracket)) {
      bracket.report->notes.push_back(warning);
      bracket.warnings.push_back(warning);
    }
    for (const std::string& warning : bracket.warnings) status_.warn(id + warning);
    ++published_;
  }
  return bracket;
}

void FusionWorker::acknowledge(const FrameFates& fates) {
  for (const FrameFate& fate : fates) {
    const bool is_used = fate.kind == FrameFate::Kind::kUsed;
    if (fate.kind == FrameFate::Kind::kHeld) {
      status_.acknowledgeEarly(fate.header);
    } else {
      status_.acknowledge(fate.header, is_used ? Outcome::kProcessed : Outcome::kInvalid, fate.reason);
    }
  }
}

}  // namespace all_in_focus
