// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <dynamic_reconfigure/server.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <string>

#include "acknowledger.hpp"
#include "callback_guard.hpp"

namespace all_in_focus {

/// Replaces each impossible value of a dynamic_reconfigure configuration by the last good one.
/// dynamic_reconfigure clamps values to the ranges in cfg/ before this sees them. So these ranges include
/// impossible values: otherwise a wrong value would silently become another one.
class ConfigRepair {
 public:
  template <typename T>
  void check(T& value, const T& good, bool possible, const char* name) {
    if (possible) return;
    warnings_ << (warnings_.tellp() > 0 ? ", " : "impossible configuration: ") << name << " = " << value
              << " (keeping " << good << ")";
    value = good;
  }

  void checkOneOf(std::string& value, const std::string& good, const std::set<std::string>& choices,
                  const char* name) {
    check(value, good, choices.count(value) > 0, name);
  }
  /// A number that must be finite, and 0 or more.
  template <typename T>
  void checkNotNegative(T& value, const T& good, const char* name) {
    check(value, good, std::isfinite(value) && value >= 0, name);
  }

  /// One line for people, "" when nothing was repaired.
  std::string warnings() const { return warnings_.str(); }

 private:
  std::ostringstream warnings_;
};

/// What the nodelets with a dynamic_reconfigure configuration share. Their onInit() calls begin() first and
/// end() last, and takeConfiguration() where reconfigure() can be called. Their destructors close the guard.
template <typename Configuration>
class ConfiguredNodelet : public nodelet::Nodelet {
 protected:
  using Config = Configuration;

  /// `config` as it is on return is shown to the user.
  virtual void reconfigure(Config& config) = 0;
  /// Called when subscribers come or go.
  virtual void connect() = 0;

  void begin(const char* processed_topic) {
    monitor_ =
        std::make_unique<Acknowledger>(getName(), getMTNodeHandle(), getPrivateNodeHandle(), processed_topic);
    guard_ = std::make_unique<CallbackGuard>(*monitor_);
    queue_size_ = std::max(1, getPrivateNodeHandle().param("queue_size", queue_size_));
  }

  /// Calls reconfigure(), now and whenever somebody changes the configuration.
  void takeConfiguration() {
    reconfigure_server_ = std::make_unique<dynamic_reconfigure::Server<Config>>(getPrivateNodeHandle());
    reconfigure_server_->setCallback(
        guard_->wrap(getName(), [this](Config& config, std::uint32_t /*level*/) { reconfigure(config); }));
  }

  /// Calls connect() once for those who have subscribed already. nodelet 1.10.1 drops callbacks while
  /// onInit() runs, so the call comes after it. What is subscribed in onInit() loses the latched messages of
  /// a topic to which another nodelet of the process has subscribed already.
  void end() {
    monitor_->start();
    const auto once = [this](const ros::WallTimerEvent&) {
      after_init_.stop();
      connect();
    };
    constexpr double kPeriod = 0.02;  // s
    after_init_ = getNodeHandle().createWallTimer(ros::WallDuration(kPeriod), guard_->wrap(getName(), once),
                                                  /*oneshot=*/false,
                                                  /*autostart=*/false);  // `once` needs after_init_
    after_init_.start();
  }

  std::unique_ptr<Acknowledger> monitor_;
  std::unique_ptr<CallbackGuard> guard_;
  Config config_ = Config::__getDefault__();  // always possible
  int queue_size_ = 5;
  std::mutex connect_mutex_;  // held while advertising: connect() may be called before onInit() is through

 private:
  ros::WallTimer after_init_;
  std::unique_ptr<dynamic_reconfigure::Server<Config>> reconfigure_server_;
};

}  // namespace all_in_focus
