// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "node_status.hpp"

#include <ros/topic_manager.h>

#include <algorithm>
#include <cctype>
#include <opencv2/core.hpp>
#include <utility>

#include "all_in_focus/bracket.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr std::chrono::seconds kSilence{5};
constexpr std::chrono::seconds kReminder{60};
constexpr std::chrono::seconds kRateWindow{10};

constexpr std::pair<Outcome, const char*> kOutcomes[] = {{Outcome::kProcessed, "processed"},
                                                         {Outcome::kDropped, "dropped"},
                                                         {Outcome::kUnmatched, "unmatched"},
                                                         {Outcome::kInvalid, "invalid"}};

}  // namespace

NodeStatus::NodeStatus(const std::string& name, ros::NodeHandle nh, const ros::NodeHandle& private_nh,
                       const std::string& processed_topic)
    : name_(name),
      nh_(nh),
      updater_(nh, private_nh, name),
      processed_(nh.advertise<std_msgs::Header>(processed_topic, 100)) {
  updater_.setHardwareID(name_);
  addOutput(processed_topic);
}

int NodeStatus::addInput(const std::string& topic, Expect expect, const std::string& remedy) {
  const std::string resolved = nh_.resolveName(topic);
  inputs_.push_back({topic, resolved, resolved, remedy, expect, 0, {}});
  topics_ += "\n  subscribes " + resolved + (expect == Expect::kOptional ? " (optional)" : "");
  return static_cast<int>(inputs_.size()) - 1;
}

std::string NodeStatus::addOutput(const std::string& topic) {
  topics_ += "\n  publishes  " + nh_.resolveName(topic);
  return topic;
}

void NodeStatus::start() {
  ROS_INFO_STREAM(name_ << ":" << topics_);
  updater_.add("processing", this, &NodeStatus::fill);
}

void NodeStatus::setSubscribed(bool subscribed) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (subscribed == subscribed_) return;
  subscribed_ = subscribed;
  subscribed_at_ = Clock::now();
  if (!subscribed) current_ = {};
}

bool NodeStatus::subscribed() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return subscribed_;
}

void NodeStatus::inputArrived(int input) {
  std::lock_guard<std::mutex> lock(mutex_);
  Input& in = inputs_.at(input);
  ++in.arrived;
  in.last_arrival = Clock::now();
}

void NodeStatus::setOnWire(int input, const std::string& topic) {
  std::lock_guard<std::mutex> lock(mutex_);
  inputs_.at(input).on_wire = topic;
}

void NodeStatus::setExpect(int input, Expect expect) {
  std::lock_guard<std::mutex> lock(mutex_);
  inputs_.at(input).expect = expect;
}

void NodeStatus::acknowledge(const std_msgs::Header& header, Outcome outcome, const std::string& reason) {
  count(outcome);
  if (outcome == Outcome::kProcessed) {
    const ros::Time now = ros::Time::now();
    std::lock_guard<std::mutex> lock(mutex_);
    processed_at_.push_back(Clock::now());
    const bool is_known = !header.stamp.isZero() && !now.isZero();
    delay_ms_ = is_known ? std::to_string(secondsBetween(header.stamp, now) * 1e3) : "unknown";
    current_ = {};
  }
  if (!reason.empty()) outcome == Outcome::kInvalid ? error(reason) : warn(reason);
  processed_.publish(header);
}

void NodeStatus::count(Outcome outcome, std::uint64_t n) {
  std::lock_guard<std::mutex> lock(mutex_);
  counts_[outcome] += n;
}

void NodeStatus::error(const std::string& text) {
  report(DiagnosticStatus::ERROR, text);
}

void NodeStatus::warn(const std::string& text) {
  report(DiagnosticStatus::WARN, text);
}

void NodeStatus::recovered() {
  std::lock_guard<std::mutex> lock(mutex_);
  current_ = {};
}

void NodeStatus::report(unsigned char level, const std::string& reason) {
  const std::string text = core::oneLine(reason);
  const bool is_error = level == DiagnosticStatus::ERROR;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (is_error) last_error_ = text;
    if (level >= current_.level) current_ = {level, text};
    if (level >= unreported_.level) unreported_ = {level, text};
    std::string key = text;
    const auto is_digit = [](unsigned char c) { return std::isdigit(c); };
    key.erase(std::remove_if(key.begin(), key.end(), is_digit), key.end());
    if (isThrottled(key)) return;
  }
  // A macro for each level: one macro keeps its level in a static variable, which all threads would share.
  if (is_error) {
    ROS_ERROR_STREAM(name_ << ": " << text);
  } else {
    ROS_WARN_STREAM(name_ << ": " << text);
  }
}

// Holds mutex_.
bool NodeStatus::isThrottled(const std::string& key) {
  const auto now = Clock::now();
  if (logged_.size() > 100) logged_.clear();
  const auto [entry, is_new] = logged_.try_emplace(key, now);
  if (!is_new && now - entry->second < kReminder) return true;
  entry->second = now;
  return false;
}

void NodeStatus::setValue(const std::string& key, const std::string& value) {
  std::lock_guard<std::mutex> lock(mutex_);
  values_[key] = value;
}

bool NodeStatus::silent(const Input& input, Clock::time_point now) const {
  if (!subscribed_ || input.expect == Expect::kOptional) return false;
  if (input.expect == Expect::kOnce && input.last_arrival >= subscribed_at_) return false;
  return now - std::max(input.last_arrival, subscribed_at_) > kSilence;
}

// Holds mutex_.
void NodeStatus::warnOfSilence(const Input& input) {
  // It knows the connected ones; the master, which may hang, need not be asked.
  const bool is_connected = ros::TopicManager::instance()->getNumPublishers(input.on_wire) > 0;
  const std::string text =
      cv::format("no data for %d s on %s: ", static_cast<int>(kSilence.count()), input.resolved.c_str()) +
      (is_connected ? "connected, but no message comes: is its publisher working, or its bag at the end?"
                    : "no publisher is connected; " + input.remedy + " (or remap it)");
  if (!isThrottled(text)) ROS_WARN_STREAM(name_ << ": " << text);
}

void NodeStatus::fill(diagnostic_updater::DiagnosticStatusWrapper& status) {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto now = Clock::now();
  while (!processed_at_.empty() && now - processed_at_.front() > kRateWindow) processed_at_.pop_front();

  Condition worst = unreported_.level >= current_.level ? unreported_ : current_;
  unreported_ = {};
  if (worst.level == DiagnosticStatus::OK) worst.text = subscribed_ ? "processing" : "idle: nobody listens";
  status.summary(worst.level, worst.text);
  for (const auto& [outcome, key] : kOutcomes) status.add(key, counts_[outcome]);
  const std::chrono::duration<double> since_first =
      now - (processed_at_.empty() ? now : processed_at_.front());
  status.add("rate [Hz]", static_cast<double>(processed_at_.size()) / std::max(1.0, since_first.count()));
  status.add("delay [ms]", delay_ms_);
  status.add("last error", last_error_);
  for (const Input& input : inputs_) {
    status.add(input.resolved, std::to_string(input.arrived) + " messages");
    if (!silent(input, now)) continue;
    status.mergeSummary(DiagnosticStatus::WARN, "no data on " + input.resolved);
    warnOfSilence(input);
  }
  for (const auto& value : values_) status.add(value.first, value.second);
}

}  // namespace all_in_focus
