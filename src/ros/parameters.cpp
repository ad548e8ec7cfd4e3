// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "parameters.hpp"

#include <boost/algorithm/string/case_conv.hpp>
#include <cmath>
#include <cstddef>
#include <cstdio>
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
  return std::is_same_v<T, std::string> ? "text" : "a list of whole numbers";
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

// As roscpp reads it; but roscpp rounds a number where a whole one is expected.
template <typename T>
bool read(const ros::NodeHandle& nh, const std::string& name, T& value) {
  return nh.getParam(name, value);
}
bool read(const ros::NodeHandle& nh, const std::string& name, int& value) {
  double number = 0;
  if (!nh.getParam(name, number) || number != std::floor(number) ||
      std::abs(number) > std::numeric_limits<int>::max())
    return false;
  value = static_cast<int>(number);
  return true;
}

// Text that can mean nothing but the value.
template <typename T>
bool parse(const std::string& text, T& value) {
  if constexpr (std::is_arithmetic_v<T>) {
    std::istringstream words(boost::algorithm::to_lower_copy(text));
    return words >> std::boolalpha >> value && words.peek() == EOF;
  }
  return false;
}

// is_possible: of a value of the right type.
template <typename T, typename Check>
void readChecked(const ros::NodeHandle& nh, const std::string& name, const std::string& expected,
                 const Check& is_possible, T& value, NodeStatus& status) {
  XmlRpcValue given;
  if (!nh.getParam(name, given)) return;
  T wanted{};
  std::string text;
  bool is_known = read(nh, name, wanted);
  const bool is_text = !is_known && nh.getParam(name, text);
  if (is_text) is_known = parse(text, wanted);
  if (!is_known || !is_possible(wanted))
    return status.error(name + " must be " + expected + ", not " + show(given) + ": using " + show(value));
  if (is_text) {
    status.warn(name + " is text: " + show(text) + " is taken as " + show(wanted) +
                "; write it without quotes");
  }
  value = wanted;
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
  const std::string expected = typeName<T>() + (" from " + show(least) + " to " + show(most));
  const auto is_within = [least, most](const T& wanted) { return wanted >= least && wanted <= most; };
  readChecked(nh, name, expected, is_within, value, status);
}

template void readParameter(const ros::NodeHandle&, const std::string&, bool&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, int&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, double&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::string&, NodeStatus&);
template void readParameter(const ros::NodeHandle&, const std::string&, std::vector<int>&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, int, int, int&, NodeStatus&);
template void readNumber(const ros::NodeHandle&, const std::string&, double, double, double&, NodeStatus&);

}  // namespace all_in_focus
