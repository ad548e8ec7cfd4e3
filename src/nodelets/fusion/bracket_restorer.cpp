// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bracket_restorer.hpp"

#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "stopwatch.hpp"

namespace all_in_focus {
namespace {

constexpr std::chrono::milliseconds kPollPeriod(20);  // of interrupted(), during a pause
constexpr const char* kProgress = "restoration";      // key of the diagnostics

}  // namespace

BracketRestorer::BracketRestorer(NodeStatus& status, Interrupted interrupted, Done done)
    : status_(status),
      interrupted_(std::move(interrupted)),
      done_(std::move(done)),
      thread_([this] { run(); }) {}

BracketRestorer::~BracketRestorer() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = dropped_ = true;
    changed_.notify_all();
  }
  thread_.join();
}

void BracketRestorer::start(const FusedBracket& bracket, const FrameFates& fates) {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return !job_; });
  job_ = Job{bracket, fates};
  given_up_.clear();
  dropped_ = false;
  changed_.notify_all();
}

void BracketRestorer::giveUp(const std::string& reason) {
  std::unique_lock<std::mutex> lock(mutex_);
  if (job_) given_up_ = reason;
  changed_.notify_all();
  changed_.wait(lock, [this] { return !job_; });
}

void BracketRestorer::drop() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (job_) dropped_ = true;
  changed_.notify_all();
  changed_.wait(lock, [this] { return !job_; });
}

void BracketRestorer::wait() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return !job_; });
}

void BracketRestorer::whenIdle(std::function<void()> callback) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (job_) return callbacks_.push_back(std::move(callback));
  }
  callback();
}

void BracketRestorer::setPaused(bool paused) {
  std::lock_guard<std::mutex> lock(mutex_);
  paused_ = paused;
  changed_.notify_all();
}

void BracketRestorer::run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopped_ || job_; });
    if (!job_) return;
    Job job = *job_;
    lock.unlock();
    restore(job.bracket);
    lock.lock();
    const bool wanted = !dropped_;
    lock.unlock();
    if (wanted && !interrupted_()) done_(job.bracket, job.fates);
    lock.lock();
    job_.reset();
    const std::vector<std::function<void()>> callbacks = std::exchange(callbacks_, {});
    lock.unlock();
    changed_.notify_all();
    for (const auto& callback : callbacks) callback();
    lock.lock();
  }
}

// After this call the bracket can be published.
void BracketRestorer::restore(FusedBracket& bracket) {
  const Stopwatch watch;
  std::string failure;
  try {
    const auto restored = bracket.restoration->restore(bracket.result.image,
                                                       [&](double done) { return proceed(bracket, done); });
    if (restored) {
      bracket.setRestored(*restored, watch.milliseconds());
    } else {
      const std::lock_guard<std::mutex> lock(mutex_);
      failure = given_up_;
    }
  } catch (const std::exception& e) {
    failure = e.what();
  }
  bracket.restoration.reset();
  status_.setValue(kProgress, "idle");
  if (failure.empty()) return;
  const std::string note = "not restored: " + failure;
  bracket.report->notes.push_back(note);
  status_.warn("bracket " + std::to_string(bracket.report->bracket_id) + ": " + note);
}

bool BracketRestorer::proceed(const FusedBracket& bracket, double done) {
  status_.setValue(kProgress, "bracket " + std::to_string(bracket.report->bracket_id) + ": " +
                                  std::to_string(std::lround(100 * done)) + " %");
  std::unique_lock<std::mutex> lock(mutex_);
  const auto unwanted = [this] { return dropped_ || !given_up_.empty() || interrupted_(); };
  while (paused_ && !unwanted()) changed_.wait_for(lock, kPollPeriod);
  return !unwanted();
}

}  // namespace all_in_focus
