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

/// The image_transport to subscribe by, from the private parameter image_transport. One that is not installed
/// is replaced with raw, with an error message: image_transport would throw.
image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeMonitor& monitor);

/// The topics that somebody publishes; none: the master does not answer as a master does.
std::optional<std::set<std::string>> publishedTopics();

/// Waits until the topics that the master lists as published are connected: a subscriber that has just
/// started may not be connected to all of them yet. Gives up after a second of wall time; does not wait for
/// the master.
void awaitPublishers(const std::vector<const ros::Subscriber*>& subscribers);

}  // namespace all_in_focus
