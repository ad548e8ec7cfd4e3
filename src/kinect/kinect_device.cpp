// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_device.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>
#include <thread>
#include <vector>

namespace all_in_focus {
namespace {

constexpr int kWidth = 640, kHeight = 480, kFps = 30;
constexpr std::chrono::milliseconds kCatchUp{100};
constexpr int kMissingEndMs = 2000;  // from a disk images come at once

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

}  // namespace

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

// OpenNI2's own pace loses images: it keeps only the last, and plays the first of a new round at once after
// it. So the player gives images when it is asked (-1), and next() keeps the pace.
void KinectDevice::setPlayback() {
  openni::PlaybackControl& control = *device_.getPlaybackControl();
  if (control.setSpeed(-1.0F) != openni::STATUS_OK ||
      control.setRepeatEnabled(playback_.repeat) != openni::STATUS_OK) {
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
    // Only now: libfreenect's driver knows registration as a property of the created depth stream.
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
    slot.stream.destroy();
    throw;
  }
  slot.running = true;
  silent_ms_ = 0;
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
  slot.stream.stop();
  slot.stream.destroy();  // some drivers let USB run until then
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
  // Waiting asks the player for an image, once each time it wakes up. What is left of the last wait's wake-up
  // call would make it two images, of which one is lost; waiting for nothing takes it away.
  openni::VideoStream* nothing = nullptr;
  if (isFile()) openni::OpenNI::waitForAnyStream(&nothing, 1, &ready, 0);
  if (openni::OpenNI::waitForAnyStream(streams.data(), streams.size(), &ready, timeout_ms) !=
      openni::STATUS_OK) {
    silent_ms_ += timeout_ms;
    return false;
  }
  silent_ms_ = 0;
  current_stream_ = static_cast<KinectStream>(ready);
  return slots_.at(ready).stream.readFrame(&current_) == openni::STATUS_OK && current_.isValid();
}

KinectDevice::Clock::time_point KinectDevice::dueTime() const {
  const auto now = Clock::now();
  if (!isFile() || rate() <= 0) return now;
  const std::uint64_t us = current_.getTimestamp();
  const int fps = std::max(1, slot(current_stream_).mode.fps);
  const double pause_us =
      us >= last_us_ ? static_cast<double>(us - last_us_) : 1e6 / fps;  // else a new round
  const auto pause = std::chrono::microseconds(std::llround(std::min(pause_us / rate(), 1e9)));
  // After a break, or far too slow a computer, there is nothing to catch up.
  return std::max(due_ + pause, now - kCatchUp);
}

bool KinectDevice::isUnplugged() const {
  return events_->unplugged;
}

bool KinectDevice::hasEnded() const {
  return isFile() && !waiting_ && (events_->ended || silent_ms_ >= kMissingEndMs);
}

}  // namespace all_in_focus
