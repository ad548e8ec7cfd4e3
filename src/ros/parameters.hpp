// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <dynamic_reconfigure/server.h>
#include <ros/node_handle.h>

#include <boost/any.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "callback_guard.hpp"
#include "node_status.hpp"

/// Parameters of a node. No value of a user is replaced silently: one line names the parameter, what is wrong
/// with it, and the value that is used.
namespace all_in_focus {

/// Reads a parameter if it is set. One of another type leaves `value` as it is. T: bool, int, double,
/// std::string.
template <typename T>
void readParameter(const ros::NodeHandle& nh, const std::string& name, T& value, NodeStatus& status);

/// The same for a number from `least` to `most`. T: int, double.
template <typename T>
void readNumber(const ros::NodeHandle& nh, const std::string& name, T least, T most, T& value,
                NodeStatus& status);

/// Reads ~invalid_values: depths in mm that mean unknown.
void readInvalidValues(const ros::NodeHandle& nh, std::vector<int>& values, NodeStatus& status);

/// Replaces an impossible value of a dynamic_reconfigure configuration by the last good one. expected: which
/// values are possible.
/// dynamic_reconfigure clamps values to the ranges in cfg/ before this sees them. So these ranges include
/// impossible values: otherwise a wrong value would silently become another one.
template <typename T>
void repair(T& value, const T& good, bool possible, const char* name, const std::string& expected,
            NodeStatus& status) {
  if (possible) return;
  std::ostringstream text;
  text << "impossible configuration: " << name << " = " << value << ", must be " << expected << ": using "
       << good;
  status.warn(text.str());
  value = good;
}
/// The same for a number. One above `most` becomes `most`: whoever sets a very long time-out wants a long
/// one.
template <typename T>
void repairNumber(T& value, const T& good, T least, T most, const char* name, NodeStatus& status) {
  std::ostringstream expected;
  expected << "from " << least << " to " << most;
  repair(value, value > most ? most : good, value >= least && value <= most, name, expected.str(), status);
}

/// The same for a name: `parse` throws std::invalid_argument where it does not know it.
template <typename Parse>
void repairName(std::string& value, const std::string& good, const Parse& parse, NodeStatus& status) {
  try {
    parse(value);
  } catch (const std::invalid_argument& e) {
    status.warn(std::string("impossible configuration: ") + e.what() + ": using " + good);
    value = good;
  }
}

/// Calls `reconfigure` with the configuration from the parameters, and whenever somebody changes it.
/// Configuration as it is on return is shown to the user. private_nh: one of the guard's.
template <typename Config>
std::unique_ptr<dynamic_reconfigure::Server<Config>> serveConfiguration(
    ros::NodeHandle& private_nh, CallbackGuard& guard, NodeStatus& status,
    const std::function<void(Config&)>& reconfigure) {
  // The server takes the default for a parameter of another type, without a word.
  const auto check = [&](const std::string& name, auto value) {
    if (!private_nh.hasParam(name)) return;
    readParameter(private_nh, name, value, status);
    private_nh.setParam(name, value);
  };
  for (const auto& parameter : Config::__getParamDescriptions__()) {
    boost::any standard;
    parameter->getValue(Config::__getDefault__(), standard);
    if (parameter->type == "bool") check(parameter->name, boost::any_cast<bool>(standard));
    if (parameter->type == "int") check(parameter->name, boost::any_cast<int>(standard));
    if (parameter->type == "double") check(parameter->name, boost::any_cast<double>(standard));
    if (parameter->type == "str") check(parameter->name, boost::any_cast<std::string>(standard));
  }
  auto server = std::make_unique<dynamic_reconfigure::Server<Config>>(private_nh);
  server->setCallback(
      guard.wrap([reconfigure](Config& config, std::uint32_t /*level*/) { reconfigure(config); }));
  return server;
}

}  // namespace all_in_focus
