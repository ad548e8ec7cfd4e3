// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/transport_hints.h>
#include <ros/node_handle.h>

#include "node_monitor.hpp"

namespace all_in_focus {

/// To subscribe as the private parameter image_transport says. One that is not installed is repaired to raw,
/// and said: image_transport would throw, which ends the nodelet manager with all that is in it.
image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeMonitor& monitor);

}  // namespace all_in_focus
