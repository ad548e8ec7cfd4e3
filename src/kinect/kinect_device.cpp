// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_device.hpp"

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "kinect_recording.hpp"

namespace all_in_focus {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kWidth = 640, kHeight = 480, kFps = 30;
constexpr std::chrono::milliseconds kCatchUp{100};     // delay after which playback stops catching up
constexpr std::chrono::milliseconds kPlayerRests{20};  // after it has delivered an image
constexpr int kMissingEndMs = 2000;  // a recording that is silent for longer has no end mark
// OpenNI2 is restarted after this time even if /sys, which may be missing, shows no new USB device.
constexpr std::chrono::minutes kStartAnyway{5};

/// Why the last call failed, in OpenNI2's own words: its indented lines as one.
std::string openNiReason() {
  std::istringstream lines(openni::OpenNI::getExtendedError());
  std::string text;
  for (std::string line; std::getline(lines >> std::ws, line);) text += (text.empty() ? "" : "; ") + line;
  return text.empty() ? "OpenNI2 gives no reason" : text;
}

/// "URI" (name, vendor)
std::string describe(const openni::DeviceInfo& info) {
  const std::string uri = info.getUri(), name = info.getName(), vendor = info.getVendor();
  const std::string what = name + (vendor.empty() ? "" : ", ") + vendor;
  return '"' + uri + '"' + (name.empty() ? "" : " (" + what + ")");
}

/// All USB devices with their kernel numbers, which are new each time a device is plugged in.
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

/// The state of OpenNI2, which is one for the whole process.
struct Session {
  std::mutex mutex;  // guards all below
  int keepers = 0, uses = 0;
  bool running = false;
  bool opened = false;  // a device was opened since the start
  std::string plugged_in;
  Clock::time_point started;

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
} g_session;

std::string describeFound(const openni::Array<openni::DeviceInfo>& devices) {
  if (devices.getSize() == 0) {
    return "no camera was found: is it plugged in and powered, may this user open it (udev), and is its "
           "OpenNI2 driver installed (a Kinect needs libfreenect's, see docs/kinect.md)?";
  }
  std::string text = "found";
  for (int i = 0; i < devices.getSize(); ++i) {
    text += (i ? ", #" : " #") + std::to_string(i + 1) + " " + describe(devices[i]);
  }
  return text;
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

/// device: see KinectDevice. Throws std::runtime_error with a list of what was found.
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

openni::SensorType sensorOf(KinectStream stream) {
  constexpr openni::SensorType kSensors[] = {openni::SENSOR_DEPTH, openni::SENSOR_IR, openni::SENSOR_COLOR};
  return kSensors[indexOf(stream)];
}

/// Pixel formats by stream, the best one first.
const std::vector<openni::PixelFormat> kFormats[] = {
    {openni::PIXEL_FORMAT_DEPTH_1_MM, openni::PIXEL_FORMAT_DEPTH_100_UM},
    {openni::PIXEL_FORMAT_GRAY16, openni::PIXEL_FORMAT_GRAY8, openni::PIXEL_FORMAT_RGB888},
    {openni::PIXEL_FORMAT_RGB888, openni::PIXEL_FORMAT_YUV422, openni::PIXEL_FORMAT_GRAY8}};

}  // namespace

OpenNiKeeper::OpenNiKeeper() {
  std::lock_guard<std::mutex> lock(g_session.mutex);
  ++g_session.keepers;
}

OpenNiKeeper::~OpenNiKeeper() {
  std::lock_guard<std::mutex> lock(g_session.mutex);
  if (--g_session.keepers == 0) g_session.stop();
}

OpenNiUse::OpenNiUse() {
  std::lock_guard<std::mutex> lock(g_session.mutex);
  if (g_session.uses == 0 && g_session.running && g_session.isOutdated()) g_session.stop();
  if (!g_session.running) g_session.start();
  ++g_session.uses;
}

OpenNiUse::~OpenNiUse() {
  std::lock_guard<std::mutex> lock(g_session.mutex);
  --g_session.uses;
}

void OpenNiUse::deviceWasOpened() {
  std::lock_guard<std::mutex> lock(g_session.mutex);
  g_session.opened = true;
}

/// A listener that the drivers call from their own threads: it only sets a flag.
class KinectDevice::Events : public openni::OpenNI::DeviceDisconnectedListener {
 public:
  explicit Events(std::string uri) : uri_(std::move(uri)) {
    openni::OpenNI::addDeviceDisconnectedListener(this);
  }
  ~Events() override { openni::OpenNI::removeDeviceDisconnectedListener(this); }
  void onDeviceDisconnected(const openni::DeviceInfo* info) override {
    if (uri_ == info->getUri()) unplugged = true;
  }

  std::atomic<bool> unplugged{false};

 private:
  const std::string uri_;
};

KinectDevice::KinectDevice(const std::string& device, const KinectPlayback& playback) : playback_(playback) {
  openDevice(device, device_);
  if (!isFile()) use_.deviceWasOpened();
  description_ = describe(device_.getDeviceInfo());
  events_ = std::make_unique<Events>(device_.getDeviceInfo().getUri());
  if (isFile()) setPlayback();
}

KinectDevice::~KinectDevice() {
  current_.release();
  for (const KinectStream stream : kKinectStreams) stop(stream);
  events_.reset();
  device_.close();
}

// When OpenNI2 keeps the pace of a recording, it loses images: it holds only the newest one, and plays the
// first image of a new round immediately after the last one. With speed -1 it delivers an image for each
// request, and next() keeps the pace. The player always repeats, and receive() sees a new round: at the end
// of a recording that it does not repeat, the player's thread is busy with looking for an image in its list
// of streams, without a lock, and crashes when stop() removes one.
void KinectDevice::setPlayback() {
  openni::PlaybackControl& control = *device_.getPlaybackControl();
  if (control.setSpeed(-1.0F) != openni::STATUS_OK || control.setRepeatEnabled(true) != openni::STATUS_OK) {
    throw std::runtime_error("cannot set how " + description_ + " is played: " + openNiReason());
  }
}

void KinectDevice::start(KinectStream stream) {
  Slot& slot = this->slot(stream);
  const std::string what = std::string("the ") + toString(stream) + " stream of " + description_;
  if (!device_.hasSensor(sensorOf(stream)))
    throw std::runtime_error(description_ + " has no " + toString(stream) + " stream");
  if (slot.stream.create(device_, sensorOf(stream)) != openni::STATUS_OK) {
    throw std::runtime_error("cannot create " + what + ": " + openNiReason());
  }
  try {
    chooseMode(stream);
    // Not earlier: in libfreenect's driver, registration is a property of the created depth stream.
    if (stream == KinectStream::kDepth && !isFile() &&
        device_.getImageRegistrationMode() != openni::IMAGE_REGISTRATION_OFF &&
        device_.setImageRegistrationMode(openni::IMAGE_REGISTRATION_OFF) != openni::STATUS_OK) {
      throw std::runtime_error("cannot switch off the hardware registration of " + what + ": " +
                               openNiReason());
    }
    if (slot.stream.isCroppingSupported() && !isFile()) slot.stream.resetCropping();
    slot.stream.setMirroringEnabled(false);
    slot.mode.mirrored = slot.stream.getMirroringEnabled();
    if (slot.stream.start() != openni::STATUS_OK) {
      throw std::runtime_error("cannot start " + what + ": " + openNiReason());
    }
  } catch (...) {
    destroy(slot);
    throw;
  }
  slot.running = true;
  slot.last_index = 0;
  silent_ms_ = 0;
}

// Only cameras have a choice: a recording keeps the mode in which it was recorded.
void KinectDevice::chooseMode(KinectStream stream) {
  Slot& slot = this->slot(stream);
  if (!isFile()) {
    const openni::Array<openni::VideoMode>& offered = slot.stream.getSensorInfo().getSupportedVideoModes();
    const openni::VideoMode* best = nullptr;
    for (const openni::PixelFormat format : kFormats[indexOf(stream)]) {
      for (int i = 0; i < offered.getSize() && best == nullptr; ++i) {
        const openni::VideoMode& mode = offered[i];
        if (mode.getPixelFormat() == format && mode.getResolutionX() == kWidth &&
            mode.getResolutionY() == kHeight && mode.getFps() == kFps) {
          best = &mode;
        }
      }
    }
    if (best != nullptr && slot.stream.setVideoMode(*best) != openni::STATUS_OK) {
      throw std::runtime_error(std::string("cannot set the ") + toString(stream) + " stream of " +
                               description_ + " to 640x480 at 30 Hz: " + openNiReason());
    }
  }
  const openni::VideoMode mode = slot.stream.getVideoMode();
  slot.mode = {mode.getResolutionX(), mode.getResolutionY(), mode.getFps(),
               slot.stream.getHorizontalFieldOfView(), false};
}

void KinectDevice::stop(KinectStream stream) {
  Slot& slot = this->slot(stream);
  if (!slot.running) return;
  slot.running = false;
  if (waiting_ && current_stream_ == stream) {
    waiting_ = false;
    current_.release();
  }
  destroy(slot);
}

void KinectDevice::destroy(Slot& slot) {
  if (isFile()) {  // the player's thread must not be in its list of streams, see setPlayback()
    if (silent_ms_ > 0) slot.stream.stop();
    std::this_thread::sleep_for(kPlayerRests);
  }
  slot.stream.stop();
  slot.stream.destroy();  // until then some drivers keep the USB transfer running
}

bool KinectDevice::next(KinectFrame& frame, int timeout_ms) {
  if (!waiting_) {
    if (!receive(timeout_ms)) return false;
    due_ = dueTime();
    last_us_ = current_.getTimestamp();
  }
  const auto end = Clock::now() + std::chrono::milliseconds(timeout_ms);
  waiting_ = due_ > end;
  std::this_thread::sleep_until(std::min(due_, end));
  if (waiting_) return false;

  frame.stream = current_stream_;
  frame.mode = slot(current_stream_).mode;
  frame.index = current_.getFrameIndex();
  frame.device_us = current_.getTimestamp();
  frame.format = current_.getVideoMode().getPixelFormat();
  frame.width = current_.getWidth();
  frame.height = current_.getHeight();
  frame.stride = current_.getStrideInBytes();
  frame.data = current_.getData();
  frame.bytes = static_cast<std::size_t>(std::max(0, current_.getDataSize()));
  return true;
}

bool KinectDevice::receive(int timeout_ms) {
  current_.release();
  std::array<openni::VideoStream*, 3> streams{};
  for (const KinectStream stream : kKinectStreams) {
    if (slot(stream).running) streams[indexOf(stream)] = &slot(stream).stream;
  }
  int ready = -1;
  // Each wake-up during a wait requests one image from the player. A wake-up left over from the wait before
  // would request a second image, and one of the two would be lost. This empty wait consumes it.
  openni::VideoStream* nothing = nullptr;
  if (isFile()) openni::OpenNI::waitForAnyStream(&nothing, 1, &ready, 0);
  if (openni::OpenNI::waitForAnyStream(streams.data(), streams.size(), &ready, timeout_ms) !=
      openni::STATUS_OK) {
    silent_ms_ += timeout_ms;
    return false;
  }
  silent_ms_ = 0;
  current_stream_ = static_cast<KinectStream>(ready);
  Slot& slot = slots_.at(ready);
  if (slot.stream.readFrame(&current_) != openni::STATUS_OK || !current_.isValid()) return false;
  ended_ = isFile() && !playback_.repeat && current_.getFrameIndex() <= slot.last_index;
  slot.last_index = current_.getFrameIndex();
  return !ended_;
}

KinectDevice::Clock::time_point KinectDevice::dueTime() const {
  const auto now = Clock::now();
  if (!isFile() || rate() <= 0) return now;
  const std::uint64_t us = current_.getTimestamp();
  const int fps = std::max(1, slot(current_stream_).mode.fps);
  const double pause_us =
      us >= last_us_ ? static_cast<double>(us - last_us_) : 1e6 / fps;  // earlier stamp: a new round
  const auto pause = std::chrono::microseconds(std::llround(std::min(pause_us / rate(), 1e9)));
  // Small delays are caught up. After a break, or on a computer that is too slow, playback goes on from now.
  return std::max(due_ + pause, now - kCatchUp);
}

bool KinectDevice::isUnplugged() const {
  return events_->unplugged;
}

bool KinectDevice::hasEnded() const {
  return isFile() && !waiting_ && (ended_ || silent_ms_ >= kMissingEndMs);
}

}  // namespace all_in_focus
