// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_worker.hpp"

#include <algorithm>
#include <chrono>

namespace all_in_focus {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kIdlePeriod(50);  // how often a gap in time is looked for
constexpr std::chrono::seconds kFinishPatience(60);
constexpr double kClockTolerance = 1;         // s that a label's stamp may be ahead of the clock
constexpr std::size_t kMaxCached = 64;        // label and depth images: two seconds of a Kinect
constexpr std::size_t kMaxBytes = 256 << 20;  // of each kind of image that is kept
constexpr std::size_t kFewest = 4;

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

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

// How many images of this size may be kept: large ones fewer, so that memory stays bounded.
std::size_t limit(std::size_t most, const sensor_msgs::Image& image) {
  const std::size_t fitting = kMaxBytes / std::max<std::size_t>(image.data.size(), 1);
  return std::min(most, std::max(kFewest, fitting));
}

template <typename Value>
void keepNewest(std::map<ros::Time, Value>& cache, std::size_t most) {
  while (cache.size() > most) cache.erase(cache.begin());
}

}  // namespace

FusionWorker::FusionWorker(NodeMonitor& monitor, Publish publish)
    : monitor_(monitor), publish_(std::move(publish)), thread_([this] { run(); }) {}

FusionWorker::~FusionWorker() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void FusionWorker::configure(const FusionSettings& settings) {
  std::lock_guard<std::mutex> lock(mutex_);
  next_settings_ = settings;
}

void FusionWorker::addFrame(const BracketFrame& frame) {
  sensor_msgs::ImageConstPtr dropped;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (queued_frames_ >= static_cast<int>(limit(next_settings_.max_queued_frames, *frame.image))) {
      const auto oldest =
          std::find_if(jobs_.begin(), jobs_.end(), [](const Job& job) { return job.frame.image; });
      dropped = oldest->frame.image;
      jobs_.erase(oldest);
      --queued_frames_;
    }
    Job job;
    job.frame = frame;
    jobs_.push_back(job);
    ++queued_frames_;
  }
  wake_.notify_all();
  if (dropped) {
    monitor_.consumed(dropped->header, Outcome::kDropped,
                      "fusion cannot keep up: oldest waiting colour frame dropped");
  }
}

void FusionWorker::addLabels(const LabelSet& set) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    labels_[set.labels->header.stamp] = set;
    keepNewest(labels_, limit(kMaxCached, *set.labels));
  }
  wake_.notify_all();
}

void FusionWorker::addDepth(const sensor_msgs::ImageConstPtr& depth) {
  std::lock_guard<std::mutex> lock(mutex_);
  depths_[depth->header.stamp] = depth;
  keepNewest(depths_, limit(kMaxCached, *depth));
}

void FusionWorker::expectLabels(bool expected) {
  std::lock_guard<std::mutex> lock(mutex_);
  labels_expected_ = expected;
}

void FusionWorker::timeWentBack(const ros::Time& now, bool ends_bracket) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    labels_.erase(labels_.upper_bound(now), labels_.end());
    depths_.erase(depths_.upper_bound(now), depths_.end());
    if (ends_bracket) {
      Job job;
      job.restart = true;
      jobs_.push_back(job);
    }
  }
  wake_.notify_all();
}

void FusionWorker::stopListening() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    jobs_.erase(std::remove_if(jobs_.begin(), jobs_.end(), [](const Job& job) { return !job.finished; }),
                jobs_.end());
    queued_frames_ = 0;
    labels_.clear();
    depths_.clear();
    dropping_ = true;
  }
  wake_.notify_all();
}

int FusionWorker::finish() {
  Job job;
  job.finished = std::make_shared<std::promise<int>>();
  std::future<int> finished = job.finished->get_future();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    jobs_.push_back(job);
  }
  wake_.notify_all();
  return finished.wait_for(kFinishPatience) == std::future_status::ready ? finished.get() : -1;
}

void FusionWorker::run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    wake_.wait_for(lock, kIdlePeriod, [this] { return stop_ || dropping_ || !jobs_.empty(); });
    if (stop_) break;
    if (dropping_) {
      dropping_ = false;
      assembler_.restart();
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
      // What the bracket holds is uncertain: it is given up.
      assembler_.restart();
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
  if (step.begin) begin(frame);
  fuse(frame, step);
  stamp_age_s_ = ros::Time::now().toSec() - info.stamp_s;
}

void FusionWorker::begin(const BracketFrame& frame) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    settings_ = next_settings_;
  }
  const Clock::time_point start = Clock::now();
  const LabelSet set = awaitLabels(frame.image->header.stamp);
  const double waited_ms = millisecondsSince(start);
  const int reference = settings_.reference >= 0 ? settings_.reference : assembler_.length() / 2;
  const std::string trouble =
      bracket_.begin(frame.image->header, assembler_.bracketId(), settings_.mode, reference, set);
  bracket_.setLabelWait(waited_ms);
  if (!trouble.empty()) monitor_.warn(trouble);
  depth_ = depthAt(set.labels ? set.labels->header.stamp : frame.image->header.stamp);
}

// The newest label image at or before the first frame: known for certain once one at or after it has come,
// unless that one is left from before /clock jumped back.
LabelSet FusionWorker::awaitLabels(const ros::Time& first_frame) {
  const auto deadline = Clock::now() + std::chrono::duration<double>(settings_.label_timeout_s);
  std::unique_lock<std::mutex> lock(mutex_);
  wake_.wait_until(lock, deadline, [&] {
    const auto next = labels_.lower_bound(first_frame);
    const ros::Time latest = std::max(first_frame, ros::Time::now()) + ros::Duration(kClockTolerance);
    return stop_ || dropping_ || !labels_expected_ || (next != labels_.end() && next->first < latest);
  });
  auto newer = labels_.upper_bound(first_frame);
  if (newer == labels_.begin()) return {};
  const auto& [stamp, set] = *--newer;
  return (first_frame - stamp).toSec() <= settings_.label_max_age_s ? set : LabelSet();
}

void FusionWorker::fuse(const BracketFrame& frame, const BracketAssembler::Step& step) {
  const std::string trouble = bracket_.add(frame.image, step.index);
  if (step.last) {
    closeBracket();
  } else if (settings_.sliding && trouble.empty()) {
    publish(/*complete=*/false);
  }
  // Told last: who hears of the frame may rely on its result.
  monitor_.consumed(frame.image->header, trouble.empty() ? Outcome::kProcessed : Outcome::kInvalid, trouble);
}

void FusionWorker::closeBracket() {
  if (!assembler_.open()) return;
  assembler_.close();
  publish(/*complete=*/true);
  depth_.reset();
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
  if (!depth_ && report.has_labels)
    depth_ = depthAt(report.label_stamp);  // labels of another process may be faster
  bracket.depth = depth_;
  bracket.frames = std::max(assembler_.length(), assembler_.seen());
  if (complete) ++published_;
  publish_(bracket);
}

sensor_msgs::ImageConstPtr FusionWorker::depthAt(const ros::Time& stamp) {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = depths_.find(stamp);
  return found == depths_.end() ? nullptr : found->second;
}

}  // namespace all_in_focus
