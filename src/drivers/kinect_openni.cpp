// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_openni.hpp"

#include <algorithm>
#include <cctype>
#include <mutex>
#include <sstream>
#include <stdexcept>

namespace all_in_focus {
namespace {

std::mutex& sessionMutex() {
  static std::mutex mutex;
  return mutex;
}

std::string describeFound(const openni::Array<openni::DeviceInfo>& devices) {
  if (devices.getSize() == 0) {
    return "no camera was found: is it plugged in and powered, may this user open it (udev), and is its "
           "OpenNI2 driver installed (a Kinect needs libfreenect's, see docs/kinect.md)?";
  }
  std::ostringstream text;
  text << "found";
  for (int i = 0; i < devices.getSize(); ++i) {
    text << (i ? ", " : " ") << "#" << i + 1 << " " << describe(devices[i]);
  }
  return text.str();
}

/// n of "#n", 0 for anything else.
int numberOf(const std::string& device) {
  const bool is_number =
      device.size() > 1 && device.size() < 5 && device[0] == '#' &&
      std::all_of(device.begin() + 1, device.end(), [](unsigned char c) { return std::isdigit(c); });
  return is_number ? std::stoi(device.substr(1)) : 0;
}

}  // namespace

std::shared_ptr<OpenNi> OpenNi::get() {
  static std::weak_ptr<OpenNi> current;
  std::lock_guard<std::mutex> lock(sessionMutex());
  std::shared_ptr<OpenNi> openni = current.lock();
  if (!openni) current = openni = std::shared_ptr<OpenNi>(new OpenNi);
  return openni;
}

OpenNi::OpenNi() {
  if (openni::OpenNI::initialize() == openni::STATUS_OK) return;
  const std::string text = openNiReason();
  openni::OpenNI::shutdown();
  throw std::runtime_error("OpenNI2 does not start: " + text);
}

OpenNi::~OpenNi() {
  std::lock_guard<std::mutex> lock(sessionMutex());
  openni::OpenNI::shutdown();
}

// They come in indented lines.
std::string openNiReason() {
  std::istringstream lines(openni::OpenNI::getExtendedError());
  std::string text;
  for (std::string line; std::getline(lines >> std::ws, line);) text += (text.empty() ? "" : "; ") + line;
  return text.empty() ? "OpenNI2 tells no reason" : text;
}

std::string describe(const openni::DeviceInfo& info) {
  std::ostringstream text;
  text << '"' << info.getUri() << '"';
  const std::string name = info.getName(), vendor = info.getVendor();
  if (!name.empty()) text << " (" << name << (vendor.empty() ? "" : ", ") << vendor << ")";
  return text.str();
}

void openDevice(const std::string& device, openni::Device& opened) {
  openni::Array<openni::DeviceInfo> found;
  openni::OpenNI::enumerateDevices(&found);
  const int number = numberOf(device);
  if (number > found.getSize() || (device.empty() && found.getSize() == 0)) {
    throw std::runtime_error((device.empty() ? "" : "there is no camera " + device + "; ") +
                             describeFound(found));
  }
  const char* uri = number > 0       ? found[number - 1].getUri()
                    : device.empty() ? openni::ANY_DEVICE
                                     : device.c_str();
  if (opened.open(uri) != openni::STATUS_OK) {
    throw std::runtime_error("cannot open " + (device.empty() ? "the first camera" : '"' + device + '"') +
                             " (" + openNiReason() + "); " + describeFound(found));
  }
}

}  // namespace all_in_focus
