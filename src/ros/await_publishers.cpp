// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "await_publishers.hpp"

#include <ros/master.h>
#include <ros/ros.h>

#include <set>
#include <string>

namespace all_in_focus {
namespace {

const ros::WallDuration kPatience(1.0);
const ros::WallDuration kPoll(0.01);

}  // namespace

void awaitPublishers(const std::vector<const ros::Subscriber*>& subscribers) {
  XmlRpc::XmlRpcValue request, response, published;
  request[0] = ros::this_node::getName();
  request[1] = "";
  if (!ros::master::execute("getPublishedTopics", request, response, published, /*wait_for_master=*/false))
    return;
  std::set<std::string> topics;
  for (int i = 0; i < published.size(); ++i) topics.insert(std::string(published[i][0]));
  const ros::WallTime end = ros::WallTime::now() + kPatience;
  for (const ros::Subscriber* subscriber : subscribers) {
    if (topics.count(subscriber->getTopic()) == 0) continue;
    while (subscriber->getNumPublishers() == 0 && ros::WallTime::now() < end) kPoll.sleep();
  }
}

}  // namespace all_in_focus
