// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "transports.hpp"

#include <image_transport/image_transport.h>
#include <ros/master.h>
#include <ros/ros.h>

#include <algorithm>
#include <set>
#include <string>

namespace all_in_focus {
namespace {

const ros::WallDuration kPatience(1.0);
const ros::WallDuration kPoll(0.01);

}  // namespace

image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeMonitor& monitor) {
  const std::string raw = "raw", package = "image_transport/";
  const std::string wanted = private_nh.param("image_transport", raw);
  if (wanted != raw) {
    const std::vector<std::string> installed = image_transport::ImageTransport(nh).getLoadableTransports();
    if (std::find(installed.begin(), installed.end(), package + wanted) == installed.end()) {
      std::string names;
      for (const std::string& name : installed) names += " " + name.substr(package.size());
      monitor.error("~image_transport: '" + wanted + "' is not installed here, only" + names + ": using raw");
      private_nh.setParam("image_transport", raw);
    }
  }
  return {raw, ros::TransportHints(), private_nh};
}

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
