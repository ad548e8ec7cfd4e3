// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>
#include <std_msgs/Header.h>

#include <string>

#include "node_monitor.hpp"

namespace all_in_focus {

/// A monitor that also tells the senders of images which of them are done with, so that a player never
/// outruns the node: it publishes their headers on a topic of their own. Thread-safe.
class Acknowledger : public NodeMonitor {
 public:
  /// topic: gets the header of every acknowledged input. The other parameters are those of NodeMonitor.
  Acknowledger(const std::string& name, ros::NodeHandle nh, const ros::NodeHandle& private_nh,
               const std::string& topic)
      : NodeMonitor(name, nh, private_nh), publisher_(nh.advertise<std_msgs::Header>(topic, 100)) {
    addOutput(topic);
  }

  /// The node is done with an input: see NodeMonitor::finished().
  void acknowledge(const std_msgs::Header& header, Outcome outcome, const std::string& reason = {}) {
    finished(header.stamp, outcome, reason);
    publisher_.publish(header);
  }

  /// Tells the sender of an input that it need not wait, before the input is used; acknowledge() is still to
  /// come.
  void acknowledgeEarly(const std_msgs::Header& header) { publisher_.publish(header); }

 private:
  ros::Publisher publisher_;
};

}  // namespace all_in_focus
