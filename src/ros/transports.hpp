// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/transport_hints.h>
#include <ros/node_handle.h>

#include <future>
#include <optional>
#include <set>
#include <string>

#include "node_status.hpp"

namespace all_in_focus {

/// The image_transport for subscriptions, from the private parameter image_transport. If it is not installed,
/// an error is logged and raw is used, because image_transport would throw.
image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeStatus& status);

/// Asks the master for the topics that are published, in a thread of its own: a master that hangs never
/// answers. The future need not be waited for. Nothing if the answer is not valid.
std::future<std::optional<std::set<std::string>>> publishedTopics();

}  // namespace all_in_focus
