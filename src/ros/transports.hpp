// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/transport_hints.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "node_monitor.hpp"

namespace all_in_focus {

/// The image_transport for subscriptions, from the private parameter image_transport. If it is not installed,
/// an error is logged and raw is used, because image_transport would throw.
image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeMonitor& monitor);

/// The topics that are published. Nothing if the master gives no valid answer.
std::optional<std::set<std::string>> publishedTopics();

/// Waits until the topics that the master lists as published are connected: a subscriber that has just
/// started may not be connected to all of them yet. Gives up after a second of wall time; does not wait for
/// the master.
void awaitPublishers(const std::vector<const ros::Subscriber*>& subscribers);

}  // namespace all_in_focus
