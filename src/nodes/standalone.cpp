// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// One nodelet in a process of its own: NODELET and NODE_NAME come from CMakeLists.txt.

#include <nodelet/loader.h>
#include <ros/ros.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, NODE_NAME);
  nodelet::Loader loader;
  nodelet::V_string nodelet_argv(argv + 1, argv + argc);
  if (!loader.load(ros::this_node::getName(), NODELET, ros::names::getRemappings(), nodelet_argv)) {
    ROS_FATAL("Cannot load nodelet %s: is the package's setup.bash sourced?", NODELET);
    return 1;
  }
  ros::spin();
  return 0;
}
