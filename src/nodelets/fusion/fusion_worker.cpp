// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_worker.hpp"

#include <algorithm>
#include <chrono>

#include "image_limit.hpp"
#include "stopwatch.hpp"

namespace all_in_focus {
namespace {

constexpr std::chrono::milliseconds kIdlePeriod(50);  // how often a gap in time is looked for
constexpr std::chrono::seconds kFinishPatience(60);

FrameInfo frameInfo(const BracketFrame& frame) {
  FrameInfo info;
  info.stamp_s = frame.image->header.stamp.toSec();
  if (frame.focus) {
    info.has_focus = true;
    info.bracket_id = frame.focus->bracket_id;
    info.index = frame.focus->index;
    info.count = frame.focus->count;
    info.last = frame.focus->last;
  }
  return info;
}

}  // namespace

FusionWorker::FusionWorker(NodeMonitor& monitor, SceneCache& scenes, Publish publish)
    : monitor_(monitor), scenes_(scenes), publish_(std::move(publish)), thread_([this] { run(); }) {}

FusionWorker::~FusionWorker() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  scenes_.close();
  thread_.join();
}

void FusionWorker::configure(const FusionSettings& settings) {
  std::lock_guard<std::mutex> lock(mutex_);
  next_settings_ = settings;
}

void FusionWorker::add(const Job& job) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    jobs_.push_back(job);
    if (job.frame.image) ++queued_frames_;
  }
  wake_.notify_all();
}

void FusionWorker::addFrame(const BracketFrame& frame) {
  sensor_msgs::ImageConstPtr dropped;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (queued_frames_ >= static_cast<int>(imageLimit(next_settings_.max_queued_frames, *frame.image))) {
      const auto oldest =
          std::find_if(jobs_.begin(), jobs_.end(), [](const Job& job) { return job.frame.image; });
      dropped = oldest->frame.image;
      jobs_.erase(oldest);
      --queued_frames_;
    }
  }
  Job job;
  job.frame = frame;
  add(job);
  if (dropped) {
    monitor_.consumed(dropped->header, Outcome::kDropped,
                      "fusion cannot keep up: oldest waiting colour frame dropped");
  }
}

void FusionWorker::restart() {
  Job job;
  job.restart = true;
  add(job);
}

void FusionWorker::stopListening() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    jobs_.erase(std::remove_if(jobs_.begin(), jobs_.end(), [](const Job& job) { return !job.finished; }),
                jobs_.end());
    queued_frames_ = 0;
    dropping_ = true;
  }
  wake_.notify_all();
}

int FusionWorker::finish() {
  Job job;
  job.finished = std::make_shared<std::promise<int>>();
  std::future<int> finished = job.finished->get_future();
  add(job);
  return finished.wait_for(kFinishPatience) == std::future_status::ready ? finished.get() : -1;
}

void FusionWorker::run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    wake_.wait_for(lock, kIdlePeriod, [this] { return stop_ || dropping_ || !jobs_.empty(); });
    if (stop_) break;
    if (dropping_) {
      dropping_ = false;
      giveUp();
    }
    Job job;
    const bool has_job = !jobs_.empty();
    if (has_job) {
      job = jobs_.front();
      jobs_.pop_front();
      if (job.frame.image) --queued_frames_;
    }
    lock.unlock();
    try {
      if (has_job) {
        handle(job);
      } else if (ros::Time::isValid() && assembler_.gapElapsed(ros::Time::now().toSec() - stamp_age_s_)) {
        closeBracket();
      }
    } catch (const std::exception& e) {
      // What the bracket holds is uncertain.
      giveUp();
      monitor_.error(std::string("fusion: ") + e.what());
      if (job.frame.image) monitor_.consumed(job.frame.image->header, Outcome::kInvalid, e.what());
      if (job.finished) job.finished->set_value(published_);
    }
    lock.lock();
  }
}

void FusionWorker::handle(const Job& job) {
  if (job.frame.image) {
    handleFrame(job.frame);
    return;
  }
  closeBracket();
  if (job.restart) assembler_.restart();
  if (job.finished) job.finished->set_value(published_);
}

void FusionWorker::handleFrame(const BracketFrame& frame) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    assembler_.configure(next_settings_.bracket);
  }
  const FrameInfo info = frameInfo(frame);
  if (assembler_.endsBefore(info)) closeBracket();
  const BracketAssembler::Step step = assembler_.add(info);
  if (!step.use) {
    monitor_.consumed(frame.image->header, Outcome::kUnmatched, step.reason);
    return;
  }
  if (step.begin) begin(frame, step.index);
  fuse(frame, step);
  stamp_age_s_ = ros::Time::now().toSec() - info.stamp_s;
}

void FusionWorker::begin(const BracketFrame& frame, int index) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    settings_ = next_settings_;
  }
  const Stopwatch watch;
  const SceneMessages scene =
      scenes_.await(frame.image->header.stamp, settings_.label_max_age_s, settings_.label_timeout_s,
                    /*whole=*/settings_.mode == Mode::kRefined);
  const double waited_ms = watch.milliseconds();
  std::string remark;
  const int reference = plannedReference(frame, index, remark);
  const std::vector<std::string> troubles =
      bracket_.begin(frame.image->header, assembler_.bracketId(), settings_.mode, reference, scene);
  bracket_.setLabelWait(waited_ms);
  for (const std::string& trouble : troubles) monitor_.warn(trouble);
  if (!remark.empty()) bracket_.note(remark);
  depth_ = scene.depth;
  depth_stamp_ = (scene.labels.labels ? *scene.labels.labels : *frame.image).header.stamp;
}

int FusionWorker::plannedReference(const BracketFrame& first, int first_index, std::string& remark) const {
  const int length = assembler_.length();
  int reference = settings_.reference >= 0 ? settings_.reference : length / 2;
  if (length > 0) reference = std::min(reference, length - 1);
  if (settings_.mode == Mode::kPaper || reference <= first_index) return reference;

  const std::string instead = ": the first frame is the reference, not frame " + std::to_string(reference);
  const auto held = static_cast<std::size_t>(reference - first_index);
  const std::size_t most = imageLimit(settings_.max_held_frames, *first.image);
  if (settings_.sliding) {
    remark = "bracket_mode sliding" + instead;
  } else if (held > most) {
    remark = "at most " + std::to_string(most) + " frames are held (max_held_frames, memory)" + instead;
  }
  return remark.empty() ? reference : first_index;
}

void FusionWorker::fuse(const BracketFrame& frame, const BracketAssembler::Step& step) {
  std::string trouble = bracket_.arrived(frame, step.index, step.last);
  const bool held = trouble.empty() && bracket_.holding();
  if (!fuseWaiting(step.index, trouble)) return;
  if (step.last) {
    closeBracket();
  } else if (settings_.sliding && trouble.empty()) {
    publish(/*complete=*/false);
  }
  // Told last: who hears of the frame may rely on its result.
  if (held) {
    monitor_.kept(frame.image->header);
  } else {
    tell(*frame.image, trouble);
  }
}

// trouble: that of the frame that has just arrived, which is not told of yet. False: nobody wants the rest.
bool FusionWorker::fuseWaiting(int arrived, std::string& trouble) {
  FusedFrame fused;
  do {
    if (!bracket_.fuseNext(fused)) return true;
    if (fused.index == arrived) {
      trouble = fused.trouble;
    } else {
      tell(*fused.image, fused.trouble);
    }
  } while (!interrupted());
  return false;
}

void FusionWorker::tell(const sensor_msgs::Image& frame, const std::string& trouble) {
  monitor_.consumed(frame.header, trouble.empty() ? Outcome::kProcessed : Outcome::kInvalid, trouble);
}

void FusionWorker::closeBracket() {
  if (!assembler_.open()) return;
  assembler_.close();
  bracket_.stopHolding();
  std::string trouble;
  if (!fuseWaiting(-1, trouble)) return;
  publish(/*complete=*/true);
  depth_.reset();
}

void FusionWorker::giveUp() {
  assembler_.restart();
  bracket_.forgetFrames();
}

void FusionWorker::publish(bool complete) {
  FusedBracket bracket = bracket_.fused(assembler_.missing());
  FusionReport& report = *bracket.report;
  const auto warn = [&](const std::string& text) {
    report.notes.push_back(text);
    if (complete) monitor_.warn("bracket " + std::to_string(report.bracket_id) + ": " + text);
  };
  if (report.frames_used == 0) warn("no frame could be used: nothing to publish");
  if (report.frames_used == 1 && complete) warn("only one frame: the result is that frame");
  if (report.frames_missing > 0) warn(std::to_string(report.frames_missing) + " frames never came");
  if (!depth_) depth_ = scenes_.depthAt(depth_stamp_);  // labels of another process may be faster
  bracket.depth = depth_;
  bracket.camera = scenes_.camera();
  bracket.frames = std::max(assembler_.length(), assembler_.seen());
  if (complete) ++published_;
  publish_(bracket);
}

bool FusionWorker::interrupted() {
  std::lock_guard<std::mutex> lock(mutex_);
  return stop_ || dropping_;
}

}  // namespace all_in_focus
