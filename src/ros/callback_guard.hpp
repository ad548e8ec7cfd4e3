// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <xmlrpcpp/XmlRpcException.h>

#include <boost/function.hpp>
#include <boost/shared_ptr.hpp>
#include <string>

#include "node_monitor.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {

/// Runs the callbacks of a nodelet in two threads of its own, and guards them:
///   * It catches all exceptions, because one that leaves a callback ends the nodelet manager and all its
///     nodelets. It counts the exception as an invalid input and reports it with the topic.
///   * After stop() no callback runs. So a nodelet is destroyed by whoever unloads it. A worker thread of the
///     manager keeps the nodelet alive while it runs one of its callbacks, and would destroy it afterwards:
///     too late for the manager's queues, which are gone by then, and beside the nodelet that is loaded next.
class CallbackGuard {
 public:
  /// nh, private_nh: those of the nodelet. monitor: must live until stop() returns.
  CallbackGuard(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, NodeMonitor& monitor);
  ~CallbackGuard() { stop(); }
  CallbackGuard(const CallbackGuard&) = delete;
  CallbackGuard& operator=(const CallbackGuard&) = delete;

  /// Their callbacks run one after the other and may take their time.
  ros::NodeHandle nh, private_nh;
  /// Its callbacks run beside those of `nh`, one after the other, and must be short.
  ros::NodeHandle quick_nh;
  /// Of nh.
  ros::CallbackQueueInterface& queue() { return working_.queue; }

  /// Starts the threads and the diagnostics. What comes before waits.
  void start();
  /// Waits for running callbacks. Must not be called from one of them.
  void stop();

  /// Guarded, a call of any arguments that returns nothing. place: begins the message of an error.
  template <typename Function>
  auto wrap(const std::string& place, Function function) const {
    return [&monitor = monitor_, place, function](auto&&... arguments) mutable {
      try {
        function(arguments...);
      } catch (const std::exception& e) {
        monitor.count(Outcome::kInvalid);
        monitor.error(place + ": " + e.what());
      } catch (const XmlRpc::XmlRpcException& e) {  // of parameters and the master; not a std::exception
        monitor.count(Outcome::kInvalid);
        monitor.error(place + ": " + e.getMessage());
      }
    };
  }

  /// Guarded, the callback of a subscription. input: its number in the monitor, which counts the arrival.
  /// Messages with an impossible stamp are refused.
  template <typename Message, typename Function>
  boost::function<void(const boost::shared_ptr<const Message>&)> input(int input, Function function) const {
    const auto checked = [&monitor = monitor_, input, function](const auto& message) mutable {
      monitor.inputArrived(input);
      requirePossible(message->header.stamp);
      function(message);
    };
    return wrap(monitor_.resolved(input), checked);
  }

 private:
  struct Thread {
    ros::CallbackQueue queue;
    ros::AsyncSpinner spinner{1, &queue};
  };

  NodeMonitor& monitor_;
  Thread working_, quick_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace all_in_focus
