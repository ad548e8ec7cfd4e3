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

// What each type is called in messages.
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

std::string show(bool value) {
  return value ? "true" : "false";
}
template <typename Number>
std::string show(Number value) {
  std::ostringstream text;
  text << value;
  return text.str();
}
std::string show(const std::string& value) {
  return '\'' + value + '\'';
}
std::string show(const std::vector<int>& values) {
  std::string text;
  for (const int value : values) text += (text.empty() ? "[" : ", ") + std::to_string(value);
  return text.empty() ? "[]" : text + "]";
}

std::string show(XmlRpcValue& value) {
  if (value.getType() == XmlRpcValue::TypeBoolean) return show(static_cast<bool>(value));
  constexpr std::size_t kMost = 60;  // characters
  std::ostringstream text;
  text << value;
  std::string shown = text.str();
  if (shown.size() > kMost) shown = shown.substr(0, kMost) + "...";
  return value.getType() == XmlRpcValue::TypeString ? show(shown) : shown;
}

// Each sets the value if it is of the type, or can be no other one of the type.
bool take(XmlRpcValue& from, bool& value) {
  if (from.getType() != XmlRpcValue::TypeBoolean) return false;
  value = static_cast<bool>(from);
  return true;
}
bool take(XmlRpcValue& from, double& value) {
  if (from.getType() == XmlRpcValue::TypeDouble) {
    value = static_cast<double>(from);
  } else if (from.getType() == XmlRpcValue::TypeInt) {
    value = static_cast<int>(from);
  } else {
    return false;
  }
  return true;
}
bool take(XmlRpcValue& from, int& value) {
  double number = 0;
  if (!take(from, number) || number != std::floor(number) ||
      std::abs(number) > std::numeric_limits<int>::max())
    return false;
  value = static_cast<int>(number);
  return true;
}
bool take(XmlRpcValue& from, std::string& value) {
  if (from.getType() != XmlRpcValue::TypeString) return false;
  value = static_cast<std::string>(from);
  return true;
}
bool take(XmlRpcValue& from, std::vector<int>& value) {
  if (from.getType() != XmlRpcValue::TypeArray) return false;
  std::vector<int> read(from.size());
  for (int i = 0; i < from.size(); ++i) {
    if (!take(from[i], read[i])) return false;
  }
  value = read;
  return true;
}

// What text says: a number, true or false, or nothing of these.
XmlRpcValue meaning(const std::string& text) {
  if (text == "true" || text == "True") return XmlRpcValue(true);
  if (text == "false" || text == "False") return XmlRpcValue(false);
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' ? XmlRpcValue(number) : XmlRpcValue();
}

template <typename T>
void refuse(XmlRpcValue& from, const std::string& name, const std::string& expected, const T& value,
            NodeStatus& status) {
  status.error(name + " must be " + expected + ", not " + show(from) + ": using " + show(value));
}

template <typename T>
bool read(const ros::NodeHandle& nh, const std::string& name, const std::string& expected, XmlRpcValue& from,
          T& value, NodeStatus& status) {
  if (!nh.getParam(name, from)) return false;
  if (take(from, value)) return true;
  if (from.getType() == XmlRpcValue::TypeString) {
    XmlRpcValue meant = meaning(from);
    if (take(meant, value)) {
      status.warn(name + " is text: " + show(from) + " is taken as " + show(value) +
                  "; write it without quotes");
      return true;
    }
  }
  refuse(from, name, expected, value, status);
  return false;
}

}  // namespace

template <typename T>
void readParameter(const ros::NodeHandle& nh, const std::string& name, T& value, NodeStatus& status) {
  XmlRpcValue from;
  read(nh, name, typeName(value), from, value, status);
}

template <typename T>
void readNumber(const ros::NodeHandle& nh, const std::string& name, T least, T most, T& value,
                NodeStatus& status) {
  const std::string expected = typeName(value) + (" from " + show(least) + " to " + show(most));
  XmlRpcValue from;
  T number = value;
  if (!read(nh, name, expected, from, number, status)) return;
  if (number >= least && number <= most) {
    value = number;
  } else {
    refuse(from, name, expected, value, status);
  }
}

template void readParameter(const ros::NodeHandle&, const std::string&, bool&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, int&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, double&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::string&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::vector<int>&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, int, int, int&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, double, double, double&, NodeStatus&);

}  // namespace all_in_focus
