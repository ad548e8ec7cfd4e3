// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nodelet/nodelet.h>

#include <memory>

#include "callback_guard.hpp"
#include "node_status.hpp"
#include "parameters.hpp"

namespace all_in_focus {

/// A node as a nodelet. The node is a class with a constructor (CallbackGuard&, NodeStatus&), and with
/// kProcessedTopic, see NodeStatus. Its callbacks run between its construction and its destruction.
template <typename Node>
class NodeletOf : public nodelet::Nodelet {
 public:
  ~NodeletOf() override {
    if (guard_) guard_->stop();
  }

 private:
  void onInit() override {
    status_ = std::make_unique<NodeStatus>(getName(), getNodeHandle(), getPrivateNodeHandle(),
                                           Node::kProcessedTopic);
    guard_ = std::make_unique<CallbackGuard>(getNodeHandle(), getPrivateNodeHandle(), *status_);
    node_ = std::make_unique<Node>(*guard_, *status_);
    status_->start();
    double period = 1;  // s; the name of the parameter is that of diagnostic_updater
    readNumber(getPrivateNodeHandle(), "diagnostic_period", 0.01, 3600.0, period, *status_);
    diagnostics_timer_ = guard_->quick.nh.createWallTimer(
        ros::WallDuration(period), guard_->wrap([this](const ros::WallTimerEvent&) { status_->tick(); }));
    guard_->start();
  }

  std::unique_ptr<NodeStatus> status_;
  std::unique_ptr<CallbackGuard> guard_;
  std::unique_ptr<Node> node_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace all_in_focus
