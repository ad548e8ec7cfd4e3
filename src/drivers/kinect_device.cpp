// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_device.hpp"

#include <algorithm>
#include <atomic>
#include <cctype>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace all_in_focus {
namespace {

constexpr int kWidth = 640, kHeight = 480, kFps = 30;

openni::SensorType sensorOf(KinectStream stream) {
  switch (stream) {
    case KinectStream::kIr:
      return openni::SENSOR_IR;
    case KinectStream::kColor:
      return openni::SENSOR_COLOR;
    default:
      return openni::SENSOR_DEPTH;
  }
}

/// Best first.
std::vector<openni::PixelFormat> formatsOf(KinectStream stream) {
  switch (stream) {
    case KinectStream::kIr:
      return {openni::PIXEL_FORMAT_GRAY16, openni::PIXEL_FORMAT_GRAY8, openni::PIXEL_FORMAT_RGB888};
    case KinectStream::kColor:
      return {openni::PIXEL_FORMAT_RGB888, openni::PIXEL_FORMAT_YUV422, openni::PIXEL_FORMAT_GRAY8};
    default:
      return {openni::PIXEL_FORMAT_DEPTH_1_MM, openni::PIXEL_FORMAT_DEPTH_100_UM};
  }
}

/// OpenNI2's own words; it leaves line ends in them.
std::string reason() {
  std::string text = openni::OpenNI::getExtendedError();
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
  return text.empty() ? "OpenNI2 tells no reason" : text;
}

std::string describe(const openni::DeviceInfo& info) {
  std::ostringstream text;
  text << '"' << info.getUri() << '"';
  const std::string name = info.getName(), vendor = info.getVendor();
  if (!name.empty()) text << " (" << name << (vendor.empty() ? "" : ", ") << vendor << ")";
  return text.str();
}

std::string describeFound(const openni::Array<openni::DeviceInfo>& devices) {
  if (devices.getSize() == 0) {
    return "no camera was found: is it plugged in and powered, may this user open it (udev), and is its "
           "OpenNI2 "
           "driver installed (a Kinect needs libfreenect's, see docs/kinect.md)?";
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

/// OpenNI2 is initialised while somebody in the process has a device open or tries to. Drivers such as
/// libfreenect's look for cameras at that moment only, so that every new attempt must begin with it.
class KinectDevice::OpenNi {
 public:
  static std::shared_ptr<OpenNi> get() {
    static std::weak_ptr<OpenNi> current;
    std::lock_guard<std::mutex> lock(mutex());
    std::shared_ptr<OpenNi> openni = current.lock();
    if (!openni) current = openni = std::shared_ptr<OpenNi>(new OpenNi);
    return openni;
  }
  ~OpenNi() {
    std::lock_guard<std::mutex> lock(mutex());
    openni::OpenNI::shutdown();
  }

 private:
  static std::mutex& mutex() {
    static std::mutex mutex;
    return mutex;
  }
  OpenNi() {
    if (openni::OpenNI::initialize() == openni::STATUS_OK) return;
    const std::string text = reason();
    openni::OpenNI::shutdown();
    throw std::runtime_error("OpenNI2 does not start: " + text);
  }
};

/// Called from threads of the drivers: only takes notes.
class KinectDevice::Events : public openni::OpenNI::DeviceDisconnectedListener,
                             public openni::OpenNI::DeviceStateChangedListener {
 public:
  explicit Events(std::string uri) : uri_(std::move(uri)) {
    openni::OpenNI::addDeviceDisconnectedListener(this);
    openni::OpenNI::addDeviceStateChangedListener(this);
  }
  ~Events() override {
    openni::OpenNI::removeDeviceDisconnectedListener(this);
    openni::OpenNI::removeDeviceStateChangedListener(this);
  }
  void onDeviceDisconnected(const openni::DeviceInfo* info) override {
    if (uri_ == info->getUri()) unplugged = true;
  }
  void onDeviceStateChanged(const openni::DeviceInfo* info, openni::DeviceState state) override {
    if (uri_ == info->getUri() && state == openni::DEVICE_STATE_EOF) ended = true;
  }

  std::atomic<bool> unplugged{false}, ended{false};

 private:
  const std::string uri_;
};

KinectDevice::KinectDevice(const std::string& device, const KinectPlayback& playback)
    : playback_(playback), openni_(OpenNi::get()) {
  open(device);
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

void KinectDevice::open(const std::string& device) {
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
  if (device_.open(uri) != openni::STATUS_OK) {
    throw std::runtime_error("cannot open " + (device.empty() ? "the first camera" : '"' + device + '"') +
                             " (" + reason() + "); " + describeFound(found));
  }
}

void KinectDevice::setPlayback() {
  openni::PlaybackControl& control = *device_.getPlaybackControl();
  const auto speed =
      static_cast<float>(playback_.manual() ? -1.0 : playback_.rate);  // -1: a frame when one is asked for
  if (control.setSpeed(speed) != openni::STATUS_OK ||
      control.setRepeatEnabled(playback_.repeat) != openni::STATUS_OK) {
    throw std::runtime_error("cannot set how " + description_ + " is played: " + reason());
  }
}

void KinectDevice::start(KinectStream stream) {
  Slot& slot = this->slot(stream);
  const std::string what = std::string("the ") + toString(stream) + " stream of " + description_;
  if (!device_.hasSensor(sensorOf(stream))) throw std::runtime_error("there is no such thing as " + what);
  if (slot.stream.create(device_, sensorOf(stream)) != openni::STATUS_OK) {
    throw std::runtime_error("cannot create " + what + ": " + reason());
  }
  try {
    chooseMode(stream);
    // Only now: libfreenect's driver knows registration as a property of the created depth stream.
    if (stream == KinectStream::kDepth && !isFile() &&
        device_.getImageRegistrationMode() != openni::IMAGE_REGISTRATION_OFF &&
        device_.setImageRegistrationMode(openni::IMAGE_REGISTRATION_OFF) != openni::STATUS_OK) {
      throw std::runtime_error("cannot switch off the hardware registration of " + what + ": " + reason());
    }
    if (slot.stream.isCroppingSupported() && !isFile()) slot.stream.resetCropping();
    slot.stream.setMirroringEnabled(false);
    slot.mode.mirrored = slot.stream.getMirroringEnabled();
    if (slot.stream.start() != openni::STATUS_OK) {
      throw std::runtime_error("cannot start " + what + ": " + reason());
    }
  } catch (...) {
    slot.stream.destroy();
    throw;
  }
  slot.running = true;
}

// A recording has the mode it was recorded with.
void KinectDevice::chooseMode(KinectStream stream) {
  Slot& slot = this->slot(stream);
  if (!isFile()) {
    const openni::Array<openni::VideoMode>& offered = slot.stream.getSensorInfo().getSupportedVideoModes();
    const openni::VideoMode* best = nullptr;
    for (const openni::PixelFormat format : formatsOf(stream)) {
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
                               description_ + " to 640x480 at 30 Hz: " + reason());
    }
  }
  const openni::VideoMode mode = slot.stream.getVideoMode();
  slot.mode = {mode.getPixelFormat(),
               mode.getResolutionX(),
               mode.getResolutionY(),
               mode.getFps(),
               slot.stream.getHorizontalFieldOfView(),
               false};
}

void KinectDevice::stop(KinectStream stream) {
  Slot& slot = this->slot(stream);
  if (!slot.running) return;
  slot.running = false;
  slot.stream.stop();
  slot.stream.destroy();  // some drivers let USB run until then
}

bool KinectDevice::next(KinectFrame& frame, int timeout_ms) {
  current_.release();
  std::array<openni::VideoStream*, 3> streams{};
  for (const KinectStream stream : kKinectStreams) {
    if (slot(stream).running) streams[static_cast<std::size_t>(stream)] = &slot(stream).stream;
  }
  int ready = -1;
  // Waiting pokes the player of a recording, once each time it wakes up. What is left of the last wait's
  // wake-up call would make it two images, of which one is lost; waiting for nothing takes it away.
  openni::VideoStream* nothing = nullptr;
  if (isFile() && playback_.manual()) openni::OpenNI::waitForAnyStream(&nothing, 1, &ready, 0);
  if (openni::OpenNI::waitForAnyStream(streams.data(), streams.size(), &ready, timeout_ms) !=
      openni::STATUS_OK) {
    return false;
  }
  Slot& from = slots_.at(ready);
  if (from.stream.readFrame(&current_) != openni::STATUS_OK || !current_.isValid()) return false;
  frame.stream = static_cast<KinectStream>(ready);
  frame.mode = from.mode;
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

bool KinectDevice::isUnplugged() const {
  return events_->unplugged;
}

bool KinectDevice::hasEnded() const {
  return events_->ended;
}

}  // namespace all_in_focus
