// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "parameters.hpp"

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <limits>

namespace all_in_focus {
namespace {

using XmlRpc::XmlRpcValue;

const char* typeName(bool) {
  return "true or false";
}
const char* typeName(int) {
  return "a whole number";
}
const char* typeName(double) {
  return "a number";
}
const char* typeName(const std::string&) {
  return "text";
}
const char* typeName(const std::vector<int>&) {
  return "a list of whole numbers";
}

std::string show(XmlRpcValue value) {
  constexpr std::size_t kMost = 60;  // characters
  std::ostringstream text;
  if (value.getType() == XmlRpcValue::TypeBoolean) return static_cast<bool>(value) ? "true" : "false";
  if (value.getType() == XmlRpcValue::TypeDouble) {
    text << static_cast<double>(value);
  } else {
    text << value;
  }
  std::string shown = text.str();
  if (shown.size() > kMost) shown = shown.substr(0, kMost) + "...";
  return value.getType() == XmlRpcValue::TypeString ? '\'' + shown + '\'' : shown;
}
std::string show(const std::vector<int>& values) {
  std::string text;
  for (const int value : values) text += (text.empty() ? "" : ", ") + std::to_string(value);
  return '[' + text + ']';
}

bool toWhole(double number, int& value) {
  if (number != std::floor(number) || std::abs(number) > std::numeric_limits<int>::max()) return false;
  value = static_cast<int>(number);
  return true;
}

// As roscpp reads it; but roscpp rounds a number where a whole one is expected.
template <typename T>
bool read(const ros::NodeHandle& nh, const std::string& name, T& value) {
  return nh.getParam(name, value);
}
bool read(const ros::NodeHandle& nh, const std::string& name, int& value) {
  double number = 0;
  return nh.getParam(name, number) && toWhole(number, value);
}

// Text that can mean nothing but the value.
template <typename T>
bool parse(const std::string&, T&) {
  return false;
}
bool parse(const std::string& text, bool& value) {
  value = text == "true" || text == "True";
  return value || text == "false" || text == "False";
}
bool parse(const std::string& text, double& value) {
  char* end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0';
}
bool parse(const std::string& text, int& value) {
  double number = 0;
  return parse(text, number) && toWhole(number, value);
}

template <typename T>
void refuse(const ros::NodeHandle& nh, const std::string& name, const std::string& expected, const T& value,
            NodeStatus& status) {
  XmlRpcValue given;
  nh.getParam(name, given);
  status.error(name + " must be " + expected + ", not " + show(given) + ": using " + show(value));
}

// False if it is not set, or refused.
template <typename T>
bool readTyped(const ros::NodeHandle& nh, const std::string& name, const std::string& expected, T& value,
               NodeStatus& status) {
  if (!nh.hasParam(name)) return false;
  T wanted{};
  std::string text;
  if (!read(nh, name, wanted)) {
    if (!nh.getParam(name, text) || !parse(text, wanted)) {
      refuse(nh, name, expected, value, status);
      return false;
    }
    status.warn(name + " is text: " + show(text) + " is taken as " + show(wanted) +
                "; write it without quotes");
  }
  value = wanted;
  return true;
}

}  // namespace

template <typename T>
void readParameter(const ros::NodeHandle& nh, const std::string& name, T& value, NodeStatus& status) {
  readTyped(nh, name, typeName(value), value, status);
}

template <typename T>
void readNumber(const ros::NodeHandle& nh, const std::string& name, T least, T most, T& value,
                NodeStatus& status) {
  const std::string expected = typeName(value) + (" from " + show(least) + " to " + show(most));
  const T before = value;
  if (!readTyped(nh, name, expected, value, status) || (value >= least && value <= most)) return;
  value = before;
  refuse(nh, name, expected, value, status);
}

template void readParameter(const ros::NodeHandle&, const std::string&, bool&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, int&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, double&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::string&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::vector<int>&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, int, int, int&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, double, double, double&, NodeStatus&);

}  // namespace all_in_focus
