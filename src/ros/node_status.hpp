// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <std_msgs/Header.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace all_in_focus {

/// Whether anybody listens to one of the publishers.
template <typename... Publishers>
bool anybodyListens(const Publishers&... publishers) {
  return ((publishers.getNumSubscribers() > 0) || ...);
}

/// How long an input may be silent before the node warns.
enum class Expect {
  kStream,    ///< warn after five seconds without a message, at any time
  kOnce,      ///< warn until the first message (calibration, latched topics)
  kOptional,  ///< never warn
};

/// What happened to an input message.
enum class Outcome {
  kProcessed,  ///< a result was published
  kDropped,    ///< valid, but the node was busy or it came too late
  kUnmatched,  ///< its partner (label image, camera info, ...) never came
  kInvalid,    ///< refused: broken or impossible
};

/// Tells how a node is doing. People: it prints the resolved topics at start, publishes counters, rate and
/// delay on /diagnostics, logs each error once, and warns of silent inputs. Senders of images: it publishes
/// the headers of those that the node is done with, so that a player never outruns the node.
///
/// When a node is made: addInput(), addOutput(). On lazy subscription: setSubscribed(). First in every input
/// callback: inputArrived() (CallbackGuard does it). When done with an input: acknowledge().
///
/// All methods are thread-safe; add inputs and outputs before start().
class NodeStatus {
 public:
  /// name: of the node, for the log and the diagnostics. nh resolves the topics. processed_topic: gets the
  /// header of every acknowledged input.
  NodeStatus(const std::string& name, ros::NodeHandle nh, const ros::NodeHandle& private_nh,
             const std::string& processed_topic);

  const std::string& name() const { return name_; }

  /// topic: not resolved. remedy: what to do when nobody publishes it. Returns the input's number.
  int addInput(const std::string& topic, Expect expect, const std::string& remedy);
  /// Returns the topic.
  std::string addOutput(const std::string& topic);
  /// Prints the resolved topics.
  void start();
  /// Publishes the diagnostics, warns of silent inputs. Call regularly, also during long callbacks.
  void tick() { updater_.force_update(); }  // update() starves after a backward jump of ROS time

  /// Lazy subscription: silence counts only while subscribed. Ends errors and warnings when it becomes false.
  /// Call it after subscribing, so that a node whose subscriptions failed tries again.
  void setSubscribed(bool subscribed);
  bool subscribed() const;

  void inputArrived(int input);
  /// The topic that the image_transport of an input subscribes to.
  void setOnWire(int input, const std::string& topic);
  /// Changes how long an input may be silent.
  void setExpect(int input, Expect expect);

  /// The node is done with an input: counts it; processed ones tell rate and delay. A reason is logged and
  /// reported like error() for kInvalid, like warn() otherwise.
  void acknowledge(const std_msgs::Header& header, Outcome outcome, const std::string& reason = {});
  /// Tells the sender of an input that it need not wait, before the input is used; count() is still to come.
  void acknowledgeEarly(const std_msgs::Header& header) { processed_.publish(header); }
  /// Counts inputs that nobody waits for (labels of the fusion, for example).
  void count(Outcome outcome, std::uint64_t n = 1);

  /// One line for people. The same text, even if its numbers differ, is logged once a minute at most. Sets
  /// the level of the diagnostics until the next kProcessed, and for one report at least.
  void error(const std::string& text);
  void warn(const std::string& text);

  /// Ends errors and warnings, as a processed input does.
  void recovered();

  /// Extra lines of the diagnostics, e.g. ("restoration", "idle").
  void setValue(const std::string& key, const std::string& value);

  const std::string& topic(int input) const { return inputs_.at(input).topic; }        ///< as it was added
  const std::string& resolved(int input) const { return inputs_.at(input).resolved; }  ///< for people

 private:
  using Clock = std::chrono::steady_clock;

  struct Input {
    std::string topic, resolved, on_wire, remedy;  // see addInput() and setOnWire()
    Expect expect;
    std::uint64_t arrived;
    Clock::time_point last_arrival;
  };
  struct Condition {
    unsigned char level = 0;
    std::string text = "ok";
  };

  void report(unsigned char level, const std::string& reason);
  bool isThrottled(const std::string& key);
  bool silent(const Input& input, Clock::time_point now) const;
  void warnOfSilence(const Input& input);
  void fill(diagnostic_updater::DiagnosticStatusWrapper& status);

  const std::string name_;
  ros::NodeHandle nh_;
  diagnostic_updater::Updater updater_;
  ros::Publisher processed_;

  std::string topics_;        // resolved, for people
  mutable std::mutex mutex_;  // guards all below, but the names of the inputs
  std::vector<Input> inputs_;
  std::map<std::string, std::string> values_;
  std::map<Outcome, std::uint64_t> counts_;
  std::map<std::string, Clock::time_point> logged_;
  bool subscribed_ = false;
  Clock::time_point subscribed_at_;
  std::deque<Clock::time_point> processed_at_;  // of the last ten seconds
  std::string delay_ms_ = "unknown";
  std::string last_error_ = "none";
  Condition current_;     // until the next processed input
  Condition unreported_;  // worst since the last report
};

}  // namespace all_in_focus
