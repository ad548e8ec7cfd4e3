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
constexpr const char* kNoSay = ": depth and optics have no say in the fusion";

std::string missing(const char* topic) {
  return std::string("no ") + topic + " in time";
}

void takeDepth(const SceneMessages& messages, SharedScene& shared) {
  if (!messages.depth) throw std::invalid_argument(missing(kDepthTopic));
  shared.depth = toDepth(messages.depth, {}, kDepthTopic);
  shared.scene.depth = shared.depth.mm;
}

void takeMeasured(const SceneMessages& messages, SharedScene& shared) {
  if (!messages.measured) throw std::invalid_argument(missing(kMeasuredTopic));
  shared.measured = toDepth(messages.measured, {}, kMeasuredTopic);
  if (shared.measured.mm.size() != shared.depth.mm.size())
    throw std::invalid_argument(std::string(kMeasuredTopic) + " is not of the size of " + kDepthTopic);
  shared.scene.measured = shared.measured.mm;
}

void takeCamera(const SceneMessages& messages, SharedScene& shared) {
  shared.scene.optics = toOptics(messages.labels.segments->optics);
  if (!messages.camera) throw std::invalid_argument(missing(kCameraTopic));
  const Camera camera = toCamera(*messages.camera, kCameraTopic);
  // The sensor does not change with the lens: a zoom leaves its pixels as they are.
  shared.scene.pixel_pitch_mm = messages.focal_length_mm / camera.fx;
  shared.scene.camera = camera;
}

}  // namespace

SharedScene toScene(const SceneMessages& messages, Mode mode) {
  SharedScene shared;
  if (!messages.labels.labels) return shared;
  shared.labels = cv_bridge::toCvShare(messages.labels.labels, sensor_msgs::image_encodings::TYPE_32SC1);
  shared.scene.labels = shared.labels->image;
  if (mode == Mode::kPaper) return shared;

  const auto attempt = [&](auto take, const char* consequence) {
    try {
      take(messages, shared);
      return true;
    } catch (const std::exception& e) {
      shared.remarks.push_back(e.what() + std::string(consequence));
      return false;
    }
  };
  if (attempt(takeDepth, kNoSay)) attempt(takeMeasured, ": filled depth counts as measured");
  attempt(takeCamera, kNoSay);
  return shared;
}

}  // namespace all_in_focus
