// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "parameters.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace all_in_focus {
namespace {

using XmlRpc::XmlRpcValue;

template <typename T>
const char* typeName() {
  if (std::is_same_v<T, bool>) return "true or false";
  if (std::is_same_v<T, int>) return "a whole number";
  if (std::is_same_v<T, double>) return "a number";
  return "text";
}

std::string show(XmlRpcValue value) {
  std::ostringstream text;
  if (value.getType() == XmlRpcValue::TypeBoolean) {
    text << (static_cast<bool>(value) ? "true" : "false");
  } else if (value.getType() == XmlRpcValue::TypeDouble) {
    text << static_cast<double>(value);
  } else if (value.getType() == XmlRpcValue::TypeString) {
    text << '\'' << value << '\'';
  } else if (value.getType() == XmlRpcValue::TypeArray) {
    for (int i = 0; i < value.size(); ++i) text << (i > 0 ? ", " : "[") << show(value[i]);
    text << ']';
  } else {
    text << value;
  }
  return text.str();
}
std::string show(const std::vector<int>& values) {
  std::string text;
  for (const int value : values) text += (text.empty() ? "" : ", ") + std::to_string(value);
  return '[' + text + ']';
}

// roscpp itself takes a fraction for a whole number, and in a list also true.
bool isWhole(XmlRpcValue given, int& value) {
  const bool is_int = given.getType() == XmlRpcValue::TypeInt;
  if (!is_int && given.getType() != XmlRpcValue::TypeDouble) return false;
  const double number = is_int ? static_cast<int>(given) : static_cast<double>(given);
  if (number != std::floor(number) || std::abs(number) > std::numeric_limits<int>::max()) return false;
  value = static_cast<int>(number);
  return true;
}

template <typename T>
bool read(const ros::NodeHandle& nh, const std::string& name, T& value) {
  return nh.getParam(name, value);
}
bool read(const ros::NodeHandle& nh, const std::string& name, int& value) {
  XmlRpcValue given;
  return nh.getParam(name, given) && isWhole(given, value);
}
bool read(const ros::NodeHandle& nh, const std::string& name, std::vector<int>& values) {
  XmlRpcValue given;
  if (!nh.getParam(name, given) || given.getType() != XmlRpcValue::TypeArray) return false;
  values.resize(given.size());
  for (int i = 0; i < given.size(); ++i) {
    if (!isWhole(given[i], values[i])) return false;
  }
  return true;
}

// is_possible: of a value of the right type.
template <typename T, typename Check>
void readChecked(const ros::NodeHandle& nh, const std::string& name, const std::string& expected,
                 const Check& is_possible, T& value, NodeStatus& status) {
  XmlRpcValue given;
  if (!nh.getParam(name, given)) return;
  T wanted{};
  if (!read(nh, name, wanted) || !is_possible(wanted))
    return status.error(name + " must be " + expected + ", not " + show(given) + ": using " + show(value));
  value = wanted;
}

template <typename T>
std::string fromTo(T least, T most) {
  return " from " + show(least) + " to " + show(most);
}

}  // namespace

template <typename T>
void readParameter(const ros::NodeHandle& nh, const std::string& name, T& value, NodeStatus& status) {
  const auto any = [](const T& /*value*/) { return true; };
  readChecked(nh, name, typeName<T>(), any, value, status);
}

template <typename T>
void readNumber(const ros::NodeHandle& nh, const std::string& name, T least, T most, T& value,
                NodeStatus& status) {
  const std::string expected = typeName<T>() + fromTo(least, most);
  const auto is_within = [least, most](const T& wanted) { return wanted >= least && wanted <= most; };
  readChecked(nh, name, expected, is_within, value, status);
}

void readInvalidValues(const ros::NodeHandle& nh, std::vector<int>& values, NodeStatus& status) {
  constexpr int kMost = std::numeric_limits<std::uint16_t>::max();
  const auto is_depth = [](int value) { return value >= 0 && value <= kMost; };
  const auto are_depths = [&](const std::vector<int>& wanted) {
    return std::all_of(wanted.begin(), wanted.end(), is_depth);
  };
  readChecked(nh, "invalid_values", "a list of whole numbers" + fromTo(0, kMost), are_depths, values, status);
}

template void readParameter(const ros::NodeHandle&, const std::string&, bool&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, int&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, double&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::string&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, int, int, int&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, double, double, double&, NodeStatus&);

}  // namespace all_in_focus
