// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bracket_scene.hpp"

#include <sensor_msgs/image_encodings.h>

#include <stdexcept>

namespace all_in_focus {
namespace {

constexpr const char* kDepthTopic = "depth_registered/image";
constexpr const char* kMeasuredTopic = "depth_registered/image_raw";
constexpr const char* kCameraTopic = "rgb/camera_info";
constexpr const char* kOpticsTopic = "rgb/optics";
constexpr const char* kNotUsed = ": depth and lens data are not used";

std::invalid_argument missing(const char* topic) {
  return std::invalid_argument(std::string("no ") + topic + " in time");
}

void takeDepth(const SceneMessages& messages, SharedScene& shared) {
  shared.depth = toDepth(messages.depth, {}, kDepthTopic);
  shared.scene.depth = shared.depth.mm;
}

void takeMeasured(const SceneMessages& messages, SharedScene& shared) {
  if (!messages.measured) throw missing(kMeasuredTopic);
  shared.measured = toDepth(messages.measured, {}, kMeasuredTopic);
  shared.scene.measured = shared.measured.mm;
}

// The pixel pitch follows from the lens that the camera was calibrated with. The sensor does not change with
// the lens. Where the lens of the calibration is unknown, it is taken to be the present one.
void takeCamera(const SceneMessages& messages, const CalibrationLens& calibration, SharedScene& shared) {
  if (!messages.camera) throw missing(kCameraTopic);
  const OpticsConstPtr optics = messages.optics ? messages.optics : calibration.optics;
  if (!optics) throw missing(kOpticsTopic);
  const Camera camera = toCamera(*messages.camera, kCameraTopic);
  shared.scene.optics = toOptics(*optics);
  shared.scene.pixel_pitch_mm = calibration.pixel_pitch_mm;
  if (calibration.pixel_pitch_mm == 0 && calibration.optics)
    shared.scene.pixel_pitch_mm = calibration.optics->focal_length_mm / camera.fx;
  shared.scene.camera = camera;
}

}  // namespace

cv_bridge::CvImageConstPtr toLabels(const sensor_msgs::ImageConstPtr& message) {
  return message ? cv_bridge::toCvShare(message, sensor_msgs::image_encodings::TYPE_32SC1) : nullptr;
}

SharedScene toScene(const SceneMessages& messages, Mode mode, const cv::Size& frame,
                    const CalibrationLens& calibration) {
  SharedScene shared;
  const auto attempt = [&shared](const auto& take, const char* effect) {
    try {
      take();
      return true;
    } catch (const std::exception& e) {
      shared.warnings.push_back(oneLine(e.what()) + effect);
      return false;
    }
  };
  if (messages.camera &&
      !attempt([&] { requireRegion(*messages.camera, frame, kCameraTopic); }, ": fused by sharpness alone"))
    return shared;
  attempt(
      [&] {
        shared.labels = toLabels(messages.labels);
        if (shared.labels) shared.scene.labels = shared.labels->image;
      },
      mode == Mode::kPaper ? ": fused by sharpness alone" : ": labels are not used");
  if (mode == Mode::kPaper) return shared;
  if (messages.depth && attempt([&] { takeDepth(messages, shared); }, kNotUsed))
    attempt([&] { takeMeasured(messages, shared); }, ": filled depth counts as measured");
  if (messages.depth || messages.camera)
    attempt([&] { takeCamera(messages, calibration, shared); }, kNotUsed);
  return shared;
}

}  // namespace all_in_focus
