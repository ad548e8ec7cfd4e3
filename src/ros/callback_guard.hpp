// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <xmlrpcpp/XmlRpcException.h>

#include <boost/function.hpp>
#include <boost/shared_ptr.hpp>
#include <memory>
#include <string>

#include "callback_gate.hpp"
#include "node_monitor.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {

/// Wraps every callback of a nodelet:
///   * It catches all exceptions, because one that leaves a callback ends the nodelet manager and all its
///     nodelets. It counts the exception as an invalid input and reports it with the topic.
///   * After close() no callback runs: CallbackGate.
class CallbackGuard {
 public:
  explicit CallbackGuard(NodeMonitor& monitor) : state_(std::make_shared<State>(monitor)) {}
  ~CallbackGuard() { close(); }
  CallbackGuard(const CallbackGuard&) = delete;
  CallbackGuard& operator=(const CallbackGuard&) = delete;

  /// Guarded, a call of any arguments that returns nothing. place: begins the message of an error.
  template <typename Function>
  auto wrap(const std::string& place, Function function) const {
    return [state = state_, place, function](auto&&... arguments) mutable {
      NodeMonitor& monitor = state->monitor;
      state->gate.run([&] {
        try {
          function(arguments...);
        } catch (const std::exception& e) {
          monitor.count(Outcome::kInvalid);
          monitor.error(place + ": " + e.what());
        } catch (const XmlRpc::XmlRpcException& e) {  // of parameters and the master; not a std::exception
          monitor.count(Outcome::kInvalid);
          monitor.error(place + ": " + e.getMessage());
        }
      });
    };
  }

  /// Guarded, the callback of a subscription. input: its number in the monitor, which counts the arrival.
  /// Messages with an impossible stamp are refused.
  template <typename Message, typename Function>
  boost::function<void(const boost::shared_ptr<const Message>&)> input(int input, Function function) const {
    NodeMonitor& monitor = state_->monitor;
    const auto checked = [&monitor, input, function](const auto& message) mutable {
      monitor.inputArrived(input);
      requirePossible(message->header.stamp);
      function(message);
    };
    return wrap(monitor.resolved(input), checked);
  }

  /// Waits for running callbacks. Must not be called from one of them.
  void close() { state_->gate.close(); }

 private:
  struct State {
    explicit State(NodeMonitor& m) : monitor(m) {}
    NodeMonitor& monitor;  // must live until close() returns
    CallbackGate gate;
  };

  std::shared_ptr<State> state_;
};

}  // namespace all_in_focus
