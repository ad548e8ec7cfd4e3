// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Loads a nodelet into a manager, and again into every manager that takes the place of one that died:
//   load_nodelet PACKAGE/TYPE MANAGER
// Name, parameters and remappings are those of this node, as with `nodelet load`.
//
// `nodelet load` learns of a dead manager by a bond. Up to bondcpp 1.8.6 a bond stays for ever if its other
// side dies between its first and its second sign of life, and for 10 s if it dies before the first. A
// connection ends with the process.

#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>

#include <algorithm>
#include <csignal>
#include <string>

namespace {

volatile std::sig_atomic_t g_end_requested = 0;

void requestEnd(int) {
  g_end_requested = 1;
}

/// Another node took this node's name, or `rosnode kill`. The nodelet must be unloaded while ROS still runs.
void onShutdownRequest(XmlRpc::XmlRpcValue&, XmlRpc::XmlRpcValue& result) {
  g_end_requested = 1;
  result = ros::xmlrpc::responseInt(1, "", 0);
}

/// One nodelet, in whichever process has the name of its manager now.
class NodeletKeeper {
 public:
  NodeletKeeper(const std::string& type, const std::string& manager)
      : name_(ros::this_node::getName()), type_(type), manager_(ros::names::resolve(manager)) {}

  bool isManagerThere() const { return ros::service::exists(manager_ + "/load_nodelet", false); }

  /// Whether the process that the nodelet was given to lives.
  bool isConnected() const { return manager_process_.isValid(); }

  /// Whether it lives, answers, and still has the nodelet.
  bool isLoaded() {
    nodelet::NodeletList list;
    if (!isConnected() || !manager_process_.call(list)) return false;
    const auto& names = list.response.nodelets;
    return std::find(names.begin(), names.end(), name_) != names.end();
  }

  /// False if the manager refuses (isConnected() then), or died.
  bool load() {
    manager_process_ = nh_.serviceClient<nodelet::NodeletList>(manager_ + "/list", true);
    if (isLoaded()) unload();  // what a killed loader has left may have other parameters
    nodelet::NodeletLoad load;
    load.request.name = name_;
    load.request.type = type_;
    for (const auto& [from, to] : ros::names::getRemappings()) {
      load.request.remap_source_args.push_back(from);
      load.request.remap_target_args.push_back(to);
    }
    return nh_.serviceClient<nodelet::NodeletLoad>(manager_ + "/load_nodelet").call(load);
  }

  void unload() {
    nodelet::NodeletUnload unload;
    unload.request.name = name_;
    nh_.serviceClient<nodelet::NodeletUnload>(manager_ + "/unload_nodelet").call(unload);
  }

  const std::string& manager() const { return manager_; }

 private:
  ros::NodeHandle nh_;
  const std::string name_, type_, manager_;
  ros::ServiceClient manager_process_;  // a connection, not a name: it ends with the process
};

const ros::WallDuration kPoll(0.1);         // a dead manager is noticed within this time
const ros::WallDuration kAskAgain(1.0);     // a nodelet that somebody unloaded within this
const ros::WallDuration kWarnPeriod(10.0);  // without a manager

/// Waits for the manager. False if it refuses the nodelet.
bool loadIntoNextManager(NodeletKeeper& keeper) {
  ros::WallTime warned = ros::WallTime::now();
  for (; !g_end_requested; kPoll.sleep()) {
    if (keeper.isManagerThere()) {
      if (keeper.load()) return true;
      if (keeper.isConnected()) return false;
    }
    if (ros::WallTime::now() - warned > kWarnPeriod) {
      ROS_WARN_STREAM("no nodelet manager " << keeper.manager() << ": start it, or name another one");
      warned = ros::WallTime::now();
    }
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "load_nodelet", ros::init_options::NoSigintHandler);
  ros::V_string arguments;
  ros::removeROSArgs(argc, argv, arguments);
  if (arguments.size() != 3) {
    ROS_FATAL("usage: load_nodelet PACKAGE/TYPE MANAGER");
    return 2;
  }
  const ros::NodeHandle nh;  // starts ROS, whose own handling of requests to end is replaced then
  std::signal(SIGINT, requestEnd);
  std::signal(SIGTERM, requestEnd);
  ros::XMLRPCManager::instance()->unbind("shutdown");
  ros::XMLRPCManager::instance()->bind("shutdown", onShutdownRequest);

  NodeletKeeper keeper(arguments[1], arguments[2]);
  while (!g_end_requested) {
    if (!keeper.isLoaded() && !loadIntoNextManager(keeper)) {
      ROS_FATAL_STREAM(keeper.manager() << " cannot load " << arguments[1] << ": its output tells why");
      return 1;
    }
    const ros::WallTime asked = ros::WallTime::now();
    while (!g_end_requested && keeper.isConnected() && ros::WallTime::now() - asked < kAskAgain)
      kPoll.sleep();
  }
  if (keeper.isConnected()) keeper.unload();
  return 0;
}
