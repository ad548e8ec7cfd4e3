// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "frame_queue.hpp"

#include <algorithm>
#include <chrono>
#include <functional>
#include <utility>
#include <vector>

#include "image_limit.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

constexpr std::chrono::milliseconds kIdlePeriod(50);  // between checks for a gap in time
constexpr std::chrono::seconds kUnderWay(5);  // longest way of a frame that was sent before time jumped

FrameInfo frameInfo(const BracketFrame& frame) {
  const double stamp_s = frame.image->header.stamp.toSec();
  if (!frame.focus) return {stamp_s};
  const FocusFrame& focus = *frame.focus;
  return {stamp_s, true, focus.bracket_id, focus.index, focus.count, focus.last != 0};
}

}  // namespace

void FrameQueue::configure(const BracketConfig& config, std::size_t most) {
  std::lock_guard<std::mutex> lock(mutex_);
  assembler_.configure(config);
  most_ = std::max<std::size_t>(most, 1);
}

void FrameQueue::add(const BracketFrame& frame, Time time) {
  const FrameInfo info = frameInfo(frame);
  FusionTask task{FusionTask::Kind::kFrame, 0, {}, frame, frame.image->header, frame.image->data.size()};
  std::vector<sensor_msgs::ImageConstPtr> dropped;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const bool goes_on = assembler_.goesOn(info) && (info.has_focus || time == Time::kBefore);
    if (time == Time::kNow || (time == Time::kUnclear && !goes_on)) {
      if (went_back_) endTime();
      if (assembler_.endsBefore(info)) endBracket();
      stamp_age_s_ = ros::Time::now().toSec() - info.stamp_s;
    }
    if (time != Time::kBefore || goes_on) dropped = append(task, info);
  }
  if (time != Time::kBefore) scenes_.frameArrived(task.header.stamp);
  changed_.notify_all();
  if (!task.step.use) status_.acknowledge(task.header, Outcome::kUnmatched, task.step.reason);
  for (const sensor_msgs::ImageConstPtr& image : dropped) {
    status_.acknowledge(image->header, Outcome::kDropped,
                        "fusion cannot keep up: oldest waiting colour frame dropped");
  }
}

// Call with mutex_ held. Returns the images that were dropped to make room.
std::vector<sensor_msgs::ImageConstPtr> FrameQueue::append(FusionTask& task, const FrameInfo& info) {
  std::vector<sensor_msgs::ImageConstPtr> dropped;
  task.step = assembler_.add(info);
  if (task.step.last) {
    assembler_.close();
    task.step.missing = assembler_.missing();
  }
  if (!task.step.use) return dropped;
  if (task.step.begin) scenes_.pin(task.header.stamp);  // before the worker asks for the scene
  tasks_.push_back(task);
  ++images_;
  bytes_ += task.bytes;
  while (images_ > most_ || (bytes_ > kMaxWaitingBytes && images_ > kFewestWaiting))
    dropped.push_back(dropOldest());
  return dropped;
}

sensor_msgs::ImageConstPtr FrameQueue::dropOldest() {
  FusionTask& oldest =
      *std::find_if(tasks_.begin(), tasks_.end(), [](const FusionTask& task) { return task.frame.image; });
  --images_;
  bytes_ -= oldest.bytes;
  return std::exchange(oldest.frame.image, nullptr);
}

void FrameQueue::endBracket() {
  if (!assembler_.open()) return;
  assembler_.close();
  tasks_.push_back({FusionTask::Kind::kEnd, assembler_.missing()});
}

void FrameQueue::restart() {
  std::lock_guard<std::mutex> lock(mutex_);
  went_back_ = std::chrono::steady_clock::now();
}

// Holds mutex_.
void FrameQueue::endTime() {
  endBracket();
  assembler_.restart();
  went_back_.reset();
}

void FrameQueue::abandon() {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto is_finish = [](const FusionTask& task) { return task.kind == FusionTask::Kind::kFinish; };
  tasks_.erase(std::remove_if(tasks_.begin(), tasks_.end(), std::not_fn(is_finish)), tasks_.end());
  tasks_.push_front({FusionTask::Kind::kAbandon});
  images_ = bytes_ = 0;
  went_back_.reset();
  assembler_.restart();
  abandoned_ = true;
  changed_.notify_all();
}

std::future<int> FrameQueue::finish() {
  const auto finished = std::make_shared<std::promise<int>>();
  std::lock_guard<std::mutex> lock(mutex_);
  endBracket();
  if (stopped_) {
    finished->set_value(-1);
  } else {
    tasks_.push_back({FusionTask::Kind::kFinish, 0, finished});
  }
  changed_.notify_all();
  return finished->get_future();
}

void FrameQueue::stop() {
  std::lock_guard<std::mutex> lock(mutex_);
  for (const FusionTask& task : tasks_) {
    if (task.finished) task.finished->set_value(-1);
  }
  tasks_.clear();
  stopped_ = true;
  changed_.notify_all();
}

std::optional<FusionTask> FrameQueue::take() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait_for(lock, kIdlePeriod, [this] { return stopped_ || !tasks_.empty(); });
  if (went_back_ && std::chrono::steady_clock::now() > *went_back_ + kUnderWay) endTime();
  if (tasks_.empty() && ros::Time::isValid() &&
      assembler_.gapElapsed(ros::Time::now().toSec() - stamp_age_s_)) {
    endBracket();
  }
  if (stopped_ || tasks_.empty()) return std::nullopt;
  FusionTask task = std::move(tasks_.front());
  tasks_.pop_front();
  if (task.frame.image) {
    --images_;
    bytes_ -= task.bytes;
  }
  if (task.kind == FusionTask::Kind::kAbandon) abandoned_ = false;
  return task;
}

bool FrameQueue::interrupted() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return stopped_ || abandoned_;
}

bool FrameQueue::stopped() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return stopped_;
}

}  // namespace all_in_focus
