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
/// guard_->start() last, and takeConfiguration() where reconfigure() can be called. Their destructors stop
/// the guard.
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
        std::make_unique<Acknowledger>(getName(), getNodeHandle(), getPrivateNodeHandle(), processed_topic);
    guard_ = std::make_unique<CallbackGuard>(getNodeHandle(), getPrivateNodeHandle(), *monitor_);
    queue_size_ = std::max(1, getPrivateNodeHandle().param("queue_size", queue_size_));
  }

  /// Calls reconfigure(), now and whenever somebody changes the configuration.
  void takeConfiguration() {
    reconfigure_server_ = std::make_unique<dynamic_reconfigure::Server<Config>>(guard_->private_nh);
    reconfigure_server_->setCallback(
        guard_->wrap(getName(), [this](Config& config, std::uint32_t /*level*/) { reconfigure(config); }));
  }

  std::unique_ptr<Acknowledger> monitor_;
  std::unique_ptr<CallbackGuard> guard_;
  Config config_ = Config::__getDefault__();  // always possible
  int queue_size_ = 5;

 private:
  std::unique_ptr<dynamic_reconfigure::Server<Config>> reconfigure_server_;
};

}  // namespace all_in_focus
