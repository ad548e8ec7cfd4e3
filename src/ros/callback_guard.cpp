// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "callback_guard.hpp"

namespace all_in_focus {
namespace {

const ros::WallDuration kDiagnosticsPeriod(1.0);

}  // namespace

CallbackGuard::CallbackGuard(const ros::NodeHandle& nodelet_nh, const ros::NodeHandle& nodelet_private_nh,
                             NodeMonitor& monitor)
    : nh(nodelet_nh), private_nh(nodelet_private_nh), quick_nh(nodelet_nh), monitor_(monitor) {
  nh.setCallbackQueue(&working_.queue);
  private_nh.setCallbackQueue(&working_.queue);
  quick_nh.setCallbackQueue(&quick_.queue);
}

void CallbackGuard::start() {
  monitor_.start();
  diagnostics_timer_ = quick_nh.createWallTimer(
      kDiagnosticsPeriod, wrap("diagnostics", [this](const ros::WallTimerEvent&) { monitor_.tick(); }));
  working_.spinner.start();
  quick_.spinner.start();
}

void CallbackGuard::stop() {
  working_.spinner.stop();
  quick_.spinner.stop();
  diagnostics_timer_.stop();
}

}  // namespace all_in_focus
