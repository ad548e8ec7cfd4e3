// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// Cameras without hardware. Each file NAME in $KINECT_TEST_DIR is a camera "frames:NAME" that is
// plugged in; it is unplugged by removing the file. The words in the file are its faults:
//   no_open, no_mode, no_start, silent, stuck_mirror, stuck_registration
//   short, small, narrow: every third image is broken
//   drop: images 10 to 14 never come   late: every fourth image comes 15 ms late
//   clock_back: the camera's clock starts again with image 30
//   forgotten: once closed it is not listed until OpenNI2 starts again, as with libfreenect's driver
//   recorded=FILE: depth from raw 16-bit images of 640x480 instead of a pattern
// While a stream runs there is a file .NAME.SENSOR (1 IR, 2 colour, 3 depth).
// Like a Kinect after power-on the cameras are mirrored, registered and not at 640x480 until they are told.

#include <Driver/OniDriverAPI.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <thread>
#include <vector>

namespace frames {

using std::chrono::microseconds;
using std::chrono::milliseconds;
namespace fs = std::filesystem;

inline const microseconds kPeriod(33333);
inline const std::string kScheme = "frames:";

inline fs::path folder() {
  const char* folder = std::getenv("KINECT_TEST_DIR");
  return folder ? folder : "/nonexistent";
}

/// The fault's words; "x=y" has the value y.
inline std::map<std::string, std::string> faultsOf(const std::string& uri) {
  std::map<std::string, std::string> faults;
  std::ifstream file(folder() / uri.substr(kScheme.size()));
  for (std::string word; file >> word;) {
    const auto equals = word.find('=');
    faults[word.substr(0, equals)] = equals == std::string::npos ? "" : word.substr(equals + 1);
  }
  return faults;
}

inline std::vector<std::uint16_t> readRaw(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  std::vector<std::uint16_t> pixels(bytes.size() / 2);
  std::memcpy(pixels.data(), bytes.data(), pixels.size() * 2);
  return pixels;
}

template <typename T>
OniStatus give(const T& value, void* data, int* size) {
  if (*size != static_cast<int>(sizeof(T))) return ONI_STATUS_BAD_PARAMETER;
  std::memcpy(data, &value, sizeof(T));
  return ONI_STATUS_OK;
}

struct Camera {
  explicit Camera(std::string uri) : uri(std::move(uri)) { readFaults(); }
  void readFaults() {
    faults = faultsOf(uri);
    if (recorded.empty() && has("recorded")) recorded = readRaw(faults["recorded"]);
  }
  bool has(const char* fault) const { return faults.count(fault) > 0; }

  const std::string uri;
  std::map<std::string, std::string> faults;  // as they were when it was opened, or a stream made or started
  std::vector<std::uint16_t> recorded;
  std::atomic<bool> plugged{true}, registered{true};
};

class Stream : public oni::driver::StreamBase {
 public:
  Stream(OniSensorType sensor, Camera& camera) : sensor_(sensor), camera_(camera) { camera.readFaults(); }
  ~Stream() override { stop(); }

  OniStatus start() override {
    camera_.readFaults();
    if (camera_.has("no_start")) return ONI_STATUS_ERROR;
    running_ = true;
    std::ofstream{sign()};
    thread_ = std::thread(&Stream::run, this);
    return ONI_STATUS_OK;
  }
  void stop() override {
    running_ = false;
    if (!thread_.joinable()) return;
    thread_.join();
    fs::remove(sign());
  }

  OniBool isPropertySupported(int id) override { return id <= ONI_STREAM_PROPERTY_MIRRORING ? TRUE : FALSE; }
  OniStatus getProperty(int id, void* data, int* size) override {
    switch (id) {
      case ONI_STREAM_PROPERTY_VIDEO_MODE:
        return give(mode_, data, size);
      case ONI_STREAM_PROPERTY_CROPPING:
        return give(OniCropping{}, data, size);
      case ONI_STREAM_PROPERTY_STRIDE:
        return give(stride(), data, size);
      case ONI_STREAM_PROPERTY_HORIZONTAL_FOV:
        return give(1.0145F, data, size);
      case ONI_STREAM_PROPERTY_VERTICAL_FOV:
        return give(0.7898F, data, size);
      case ONI_STREAM_PROPERTY_MIRRORING:
        return give(OniBool{mirrored_}, data, size);
      case ONI_STREAM_PROPERTY_MAX_VALUE:
        return give(10000, data, size);
      case ONI_STREAM_PROPERTY_MIN_VALUE:
        return give(0, data, size);
      default:
        return ONI_STATUS_NOT_SUPPORTED;
    }
  }
  OniStatus setProperty(int id, const void* data, int size) override {
    if (id == ONI_STREAM_PROPERTY_VIDEO_MODE && size == sizeof(OniVideoMode) && !camera_.has("no_mode")) {
      std::memcpy(&mode_, data, size);
    } else if (id == ONI_STREAM_PROPERTY_MIRRORING && size == sizeof(OniBool) &&
               !camera_.has("stuck_mirror")) {
      mirrored_ = *static_cast<const OniBool*>(data) != FALSE;
    } else if (id != ONI_STREAM_PROPERTY_CROPPING) {
      return ONI_STATUS_NOT_SUPPORTED;
    }
    raisePropertyChanged(id, data, size);
    return ONI_STATUS_OK;
  }
  // Recorders ask for them.
  void notifyAllProperties() override {
    for (const int id :
         {ONI_STREAM_PROPERTY_VIDEO_MODE, ONI_STREAM_PROPERTY_CROPPING, ONI_STREAM_PROPERTY_STRIDE,
          ONI_STREAM_PROPERTY_HORIZONTAL_FOV, ONI_STREAM_PROPERTY_VERTICAL_FOV, ONI_STREAM_PROPERTY_MIRRORING,
          ONI_STREAM_PROPERTY_MAX_VALUE}) {
      for (int size :
           {1, 2, 4, 8, static_cast<int>(sizeof(OniVideoMode)), static_cast<int>(sizeof(OniCropping))}) {
        char value[64];
        if (getProperty(id, value, &size) == ONI_STATUS_OK) raisePropertyChanged(id, value, size);
      }
    }
  }

 private:
  fs::path sign() const {
    return folder() / ("." + camera_.uri.substr(kScheme.size()) + "." + std::to_string(sensor_));
  }
  int pixelBytes() const { return sensor_ == ONI_SENSOR_COLOR ? 3 : 2; }
  int stride() const { return mode_.resolutionX * pixelBytes(); }

  void run() {
    const auto begin = std::chrono::steady_clock::now();
    for (int index = 1; running_; ++index) {
      const bool late = camera_.has("late") && index % 4 == 0;
      std::this_thread::sleep_until(begin + index * kPeriod + milliseconds(late ? 15 : 0));
      if (!running_ || !camera_.plugged || camera_.has("silent")) continue;
      if (camera_.has("drop") && index >= 10 && index < 15) continue;
      OniFrame* frame = getServices().acquireFrame();
      if (frame == nullptr) continue;
      fill(*frame, index);
      raiseNewFrame(frame);
      getServices().releaseFrame(frame);
    }
  }

  void fill(OniFrame& frame, int index) const {
    const int restart = camera_.has("clock_back") ? 30 : 0;
    frame.frameIndex = index;
    frame.timestamp = 5000000 + kPeriod.count() * (index >= restart ? index - restart : index + 1000);
    frame.sensorType = sensor_;
    frame.videoMode = mode_;
    frame.width = mode_.resolutionX;
    frame.height = mode_.resolutionY;
    frame.stride = stride();
    frame.cropOriginX = frame.cropOriginY = 0;
    frame.croppingEnabled = FALSE;
    for (int y = 0; y < frame.height; ++y) {
      for (int x = 0; x < frame.width; ++x) {
        draw(static_cast<std::uint8_t*>(frame.data) + y * frame.stride + x * pixelBytes(), x, y, index);
      }
    }
    if (index % 3 != 0) return;
    if (camera_.has("short")) frame.dataSize /= 2;
    if (camera_.has("small")) frame.width = 320;
    if (camera_.has("narrow")) frame.stride = 100;
  }

  void draw(std::uint8_t* pixel, int x, int y, int index) const {
    if (mirrored_) x = mode_.resolutionX - 1 - x;
    if (sensor_ == ONI_SENSOR_COLOR) {
      const int rgb[] = {x, y, index};
      for (int c = 0; c < 3; ++c) pixel[c] = static_cast<std::uint8_t>(rgb[c]);
      return;
    }
    int value = (x + y + index) % 1024;
    if (sensor_ == ONI_SENSOR_DEPTH) value = depth(x, y, index) + (camera_.registered ? 5000 : 0);
    const auto value16 = static_cast<std::uint16_t>(value);
    std::memcpy(pixel, &value16, 2);
  }

  int depth(int x, int y, int index) const {
    const std::size_t size = 640 * 480, images = camera_.recorded.size() / size;
    if (images == 0) return 400 + (x + 2 * y + 10 * index) % 3000;
    return camera_.recorded[(index - 1) % images * size + y * 640 + x];
  }

  const OniSensorType sensor_;
  Camera& camera_;
  OniVideoMode mode_{sensor_ == ONI_SENSOR_COLOR ? ONI_PIXEL_FORMAT_RGB888
                     : sensor_ == ONI_SENSOR_IR  ? ONI_PIXEL_FORMAT_GRAY16
                                                 : ONI_PIXEL_FORMAT_DEPTH_1_MM,
                     320, 240, 60};
  bool mirrored_ = true;
  std::atomic<bool> running_{false};
  std::thread thread_;
};

}  // namespace frames
