// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// An OpenNI2 driver for the cameras of frames_stream.hpp.

#include <algorithm>
#include <memory>
#include <mutex>
#include <set>

#include "frames_stream.hpp"

// OpenNI2's header wants them from a library that is not shipped.
#define XN_NEW(type, ...) new type(__VA_ARGS__)
#define XN_DELETE(p) delete (p)

namespace frames {

class Device : public oni::driver::DeviceBase {
 public:
  explicit Device(const std::string& uri) : camera(uri) {
    const OniSensorType types[] = {ONI_SENSOR_DEPTH, ONI_SENSOR_IR, ONI_SENSOR_COLOR};
    const OniPixelFormat formats[] = {ONI_PIXEL_FORMAT_DEPTH_1_MM, ONI_PIXEL_FORMAT_GRAY16,
                                      ONI_PIXEL_FORMAT_RGB888};
    for (int i = 0; i < 3; ++i) {
      modes_[i][0] = {formats[i], 320, 240, 60};
      modes_[i][1] = {formats[i], 640, 480, 30};
      sensors_[i] = {types[i], 2, modes_[i]};
    }
  }

  OniStatus getSensorInfoList(OniSensorInfo** sensors, int* count) override {
    *sensors = sensors_;
    *count = 3;
    return ONI_STATUS_OK;
  }
  oni::driver::StreamBase* createStream(OniSensorType sensor) override { return new Stream(sensor, camera); }
  void destroyStream(oni::driver::StreamBase* stream) override { delete stream; }

  OniBool isPropertySupported(int id) override { return id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION; }
  OniBool isImageRegistrationModeSupported(OniImageRegistrationMode) override { return TRUE; }
  OniStatus getProperty(int id, void* data, int* size) override {
    if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION) return ONI_STATUS_NOT_SUPPORTED;
    return give(camera.registered ? ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR : ONI_IMAGE_REGISTRATION_OFF, data,
                size);
  }
  OniStatus setProperty(int id, const void* data, int) override {
    if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION || camera.has("stuck_registration"))
      return ONI_STATUS_NOT_SUPPORTED;
    camera.registered = *static_cast<const OniImageRegistrationMode*>(data) != ONI_IMAGE_REGISTRATION_OFF;
    return ONI_STATUS_OK;
  }

  Camera camera;

 private:
  OniVideoMode modes_[3][2];
  OniSensorInfo sensors_[3];
};

class Driver : public oni::driver::DriverBase {
 public:
  explicit Driver(OniDriverServices* services) : DriverBase(services) {}

  OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                       oni::driver::DeviceDisconnectedCallback disconnected,
                       oni::driver::DeviceStateChangedCallback state_changed, void* cookie) override {
    DriverBase::initialize(connected, disconnected, state_changed, cookie);
    watch();
    watching_ = true;
    thread_ = std::thread([this] {
      for (; watching_; std::this_thread::sleep_for(milliseconds(20))) watch();
    });
    return ONI_STATUS_OK;
  }
  void shutdown() override {
    watching_ = false;
    if (thread_.joinable()) thread_.join();
  }

  oni::driver::DeviceBase* deviceOpen(const char* uri, const char*) override {
    auto device = std::make_unique<Device>(uri);
    if (device->camera.has("no_open")) {
      getServices().errorLoggerAppend("the camera is in use");
      return nullptr;
    }
    std::lock_guard<std::mutex> lock(mutex_);
    open_.push_back(device.get());
    return device.release();
  }
  void deviceClose(oni::driver::DeviceBase* device) override {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      Camera& camera = static_cast<Device*>(device)->camera;
      if (camera.has("forgotten")) forgotten_.insert(camera.uri);
      open_.erase(std::remove(open_.begin(), open_.end(), static_cast<Device*>(device)), open_.end());
    }
    delete device;
  }

 private:
  void watch() {
    std::map<std::string, OniDeviceInfo> now;
    std::unique_lock<std::mutex> lock(mutex_);
    std::error_code error;
    for (const auto& file : fs::directory_iterator(folder(), error)) {
      if (file.path().filename().string()[0] == '.') continue;
      if (forgotten_.count(kScheme + file.path().filename().string())) continue;
      OniDeviceInfo info{};
      std::strncpy(info.uri, (kScheme + file.path().filename().string()).c_str(), ONI_MAX_STR - 1);
      std::strncpy(info.vendor, "all_in_focus", ONI_MAX_STR - 1);
      std::strncpy(info.name, "Test camera", ONI_MAX_STR - 1);
      now[info.uri] = info;
    }
    const std::map<std::string, OniDeviceInfo> before = plugged_;
    plugged_ = now;
    for (Device* device : open_) device->camera.plugged = now.count(device->camera.uri) > 0;
    lock.unlock();  // OpenNI2 may call back
    for (const auto& [uri, info] : before) {
      if (!now.count(uri)) deviceDisconnected(&info);
    }
    for (const auto& [uri, info] : now) {
      if (!before.count(uri)) deviceConnected(&info);
    }
  }

  std::map<std::string, OniDeviceInfo> plugged_;
  std::atomic<bool> watching_{false};
  std::thread thread_;
  std::mutex mutex_;
  std::vector<Device*> open_;
  std::set<std::string> forgotten_;
};

}  // namespace frames

ONI_EXPORT_DRIVER(frames::Driver)
