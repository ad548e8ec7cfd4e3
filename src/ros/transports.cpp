// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "transports.hpp"

#include <image_transport/image_transport.h>
#include <ros/master.h>
#include <ros/ros.h>
#include <xmlrpcpp/XmlRpcException.h>

#include <algorithm>
#include <thread>
#include <utility>
#include <vector>

namespace all_in_focus {
namespace {

std::optional<std::set<std::string>> askForPublishedTopics() {
  XmlRpc::XmlRpcValue request, response, published;
  request[0] = ros::this_node::getName();
  request[1] = "";
  if (!ros::master::execute("getPublishedTopics", request, response, published, /*wait_for_master=*/false))
    return std::nullopt;
  std::set<std::string> topics;
  try {
    for (int i = 0; i < published.size(); ++i) topics.insert(std::string(published[i][0]));
  } catch (const XmlRpc::XmlRpcException&) {
    return std::nullopt;
  }
  return topics;
}

}  // namespace

image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeStatus& status) {
  const std::string raw = "raw", package = "image_transport/";
  const std::string wanted = private_nh.param("image_transport", raw);
  if (wanted != raw) {
    const std::vector<std::string> installed = image_transport::ImageTransport(nh).getLoadableTransports();
    if (std::find(installed.begin(), installed.end(), package + wanted) == installed.end()) {
      std::string names;
      for (const std::string& name : installed) names += " " + name.substr(package.size());
      status.error("~image_transport: '" + wanted + "' is not installed here, only" + names + ": using raw");
      private_nh.setParam("image_transport", raw);
    }
  }
  return {raw, ros::TransportHints(), private_nh};
}

std::future<std::optional<std::set<std::string>>> publishedTopics() {
  std::packaged_task<std::optional<std::set<std::string>>()> ask(askForPublishedTopics);
  auto published = ask.get_future();
  std::thread(std::move(ask)).detach();
  return published;
}

}  // namespace all_in_focus
