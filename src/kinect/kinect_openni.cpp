// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_openni.hpp"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>

#include "kinect_recording.hpp"

namespace all_in_focus {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::minutes kStartAnyway{5};  // where /sys does not show what is plugged in

/// The numbers that the kernel gives to USB devices, each time anew.
std::string pluggedIn() {
  namespace fs = std::filesystem;
  std::set<std::string> devices;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/sys/bus/usb/devices", error)) {
    std::ifstream file(entry.path() / "devnum");
    std::string number;
    if (file >> number) devices.insert(entry.path().filename().string() + "=" + number);
  }
  std::string text;
  for (const std::string& device : devices) text += device + " ";
  return text;
}

/// Of the process.
struct Session {
  std::mutex mutex;  // guards all below
  int keepers = 0, uses = 0;
  bool running = false;
  bool opened = false;  // a device, since the start
  std::string plugged_in;
  Clock::time_point started;

  static Session& get() {
    static Session session;
    return session;
  }

  bool isOutdated() const {
    return opened || Clock::now() - started > kStartAnyway || pluggedIn() != plugged_in;
  }
  void start() {
    plugged_in = pluggedIn();
    if (openni::OpenNI::initialize() != openni::STATUS_OK) {
      const std::string text = openNiReason();
      openni::OpenNI::shutdown();
      throw std::runtime_error("OpenNI2 does not start: " + text);
    }
    running = true;
    opened = false;
    started = Clock::now();
  }
  void stop() {
    if (running) openni::OpenNI::shutdown();
    running = false;
  }
};

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

void openFile(const std::string& path, openni::Device& opened) {
  requireRecording(path);
  if (opened.open(path.c_str()) != openni::STATUS_OK) {
    throw std::runtime_error("cannot open \"" + path + "\" (" + openNiReason() +
                             "): it is damaged, or recorded by something else than OpenNI; record it again");
  }
}

}  // namespace

OpenNiKeeper::OpenNiKeeper() {
  Session& session = Session::get();
  std::lock_guard<std::mutex> lock(session.mutex);
  ++session.keepers;
}

OpenNiKeeper::~OpenNiKeeper() {
  Session& session = Session::get();
  std::lock_guard<std::mutex> lock(session.mutex);
  if (--session.keepers == 0) session.stop();
}

OpenNiUse::OpenNiUse() {
  Session& session = Session::get();
  std::lock_guard<std::mutex> lock(session.mutex);
  if (session.uses == 0 && session.running && session.isOutdated()) session.stop();
  if (!session.running) session.start();
  ++session.uses;
}

OpenNiUse::~OpenNiUse() {
  Session& session = Session::get();
  std::lock_guard<std::mutex> lock(session.mutex);
  --session.uses;
}

void OpenNiUse::deviceWasOpened() {
  Session& session = Session::get();
  std::lock_guard<std::mutex> lock(session.mutex);
  session.opened = true;
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
  if (isFileName(device)) return openFile(device, opened);
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
