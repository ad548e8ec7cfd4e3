// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/subscriber.h>

#include <vector>

namespace all_in_focus {

/// Waits until the topics that the master lists as published are connected: what has just started may not be
/// connected yet with all its topics. Gives up after a second of wall time; does not wait for the master.
void awaitPublishers(const std::vector<const ros::Subscriber*>& subscribers);

}  // namespace all_in_focus
