// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/subscriber.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <xmlrpcpp/XmlRpcException.h>

#include <boost/function.hpp>
#include <boost/shared_ptr.hpp>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>

#include "node_status.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {

/// Runs the callbacks of a nodelet in two threads of its own, and guards them. These are all threads that a
/// node needs: one for what is quick, one for what takes its time.
///   * It catches all exceptions, because one that leaves a callback ends the nodelet manager and all its
///     nodelets. It counts the exception as an invalid input and reports it with the topic.
///   * After stop() no callback runs. So a nodelet is destroyed by whoever unloads it. A worker thread of the
///     manager keeps the nodelet alive while it runs one of its callbacks, and would destroy it afterwards:
///     too late for the manager's queues, which are gone by then, and beside the nodelet that is loaded next.
class CallbackGuard {
 public:
  using ImageCallback = std::function<void(const sensor_msgs::ImageConstPtr&)>;

  /// nh, private_nh: those of the nodelet. status: must live until stop() returns.
  CallbackGuard(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, NodeStatus& status);

  /// Runs the callbacks of its handles, one after the other.
  struct Thread {
    Thread(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
    ros::NodeHandle nh, private_nh;
    ros::CallbackQueue queue;
    ros::AsyncSpinner spinner{1, &queue};
  };
  Thread slow;   ///< for callbacks that take their time
  Thread quick;  ///< for callbacks that are short

  /// Called by stop() after the last quick callback. It must wake a slow callback that waits.
  std::function<void()> on_stop;

  /// Starts the threads. What comes before waits.
  void start();
  /// Waits for running callbacks. Must not be called from one of them.
  void stop();

  /// Guarded, a call of any arguments that returns nothing. place: begins the message of an error.
  template <typename Function>
  auto wrap(Function function, const std::string& place = {}) const {
    return [&status = status_, place, function](auto&&... arguments) mutable {
      try {
        function(arguments...);
      } catch (const std::exception& e) {
        status.count(Outcome::kInvalid);
        status.error(place + e.what());
      } catch (const XmlRpc::XmlRpcException& e) {  // of parameters and the master; not a std::exception
        status.count(Outcome::kInvalid);
        status.error(place + e.getMessage());
      }
    };
  }

  /// Runs a function among the slow callbacks, after all that wait there.
  void post(const std::function<void()>& function);

  /// Subscribes to an input of the status, which counts the arrivals. Messages with an impossible stamp are
  /// refused. on: one of the threads above.
  template <typename Message, typename Function>
  ros::Subscriber subscribe(Thread& on, int input, Function function) {
    constexpr bool is_image = std::is_same_v<Message, sensor_msgs::Image>;
    return on.nh.subscribe<Message>(status_.topic(input), is_image ? kArrivingImages : kArrivingMessages,
                                    checked<Message>(input, function));
  }

  /// The same for images, by the image_transport of the parameters. receive: a quick callback. lossless: by
  /// no transport that may change values.
  image_transport::Subscriber receiveImages(int input, const ImageCallback& receive, bool lossless = false);

  /// The same for depth images, lossless. They take long to process: they wait for their turn among the slow
  /// callbacks. Where the node cannot keep up the oldest are dropped, counted and acknowledged;
  /// roscpp's own queue would drop them silently. One at which `process` throws is acknowledged as invalid.
  /// most: how many may wait, within imageLimit().
  image_transport::Subscriber subscribeToDepth(int input, std::size_t most, const ImageCallback& process);

 private:
  // Callbacks hand messages over at once or are quick, but on a busy computer a thread waits for its turn,
  // and what roscpp drops is not counted.
  static constexpr std::uint32_t kArrivingImages = 64, kArrivingMessages = 1000;

  template <typename Message, typename Function>
  boost::function<void(const boost::shared_ptr<const Message>&)> checked(int input, Function function) const {
    const auto check_and_call = [&status = status_, input, function](const auto& message) mutable {
      status.inputArrived(input);
      if constexpr (ros::message_traits::HasHeader<Message>::value) requirePossible(message->header.stamp);
      function(message);
    };
    return wrap(check_and_call, status_.resolved(input) + ": ");
  }

  NodeStatus& status_;
};

}  // namespace all_in_focus
