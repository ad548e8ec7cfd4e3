// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bracket_scene.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <stdexcept>

#include "topics.hpp"

namespace all_in_focus {
namespace {

constexpr const char* kNotUsed = ": depth and lens data are not used";
constexpr const char* kBySharpness = ": fused by sharpness alone";
constexpr const char* kNoLabels = ": labels are not used";
constexpr const char* kNotPublished = ": the result has no depth";

std::invalid_argument missing(const char* topic) {
  return std::invalid_argument(std::string("no ") + topic + " in time");
}

// Returns whether it could be taken. If not, a warning tells of it.
template <typename Take>
bool attempt(SharedScene& shared, const Take& take, const std::string& effect) {
  try {
    take(shared);
    return true;
  } catch (const std::exception& e) {
    shared.warnings.push_back(oneLine(e.what()) + effect);
    return false;
  }
}

void takeLabels(SharedScene& shared) {
  shared.scene.labels =
      cv_bridge::toCvShare(shared.messages.labels, sensor_msgs::image_encodings::TYPE_32SC1)->image;
}

void takeDepth(SharedScene& shared) {
  shared.scene.depth = toDepth(*shared.messages.depth, {}, topics::kDepth);
}

void takeMeasured(SharedScene& shared) {
  if (!shared.messages.measured) throw missing(topics::kMeasured);
  shared.scene.measured = toDepth(*shared.messages.measured, {}, topics::kMeasured);
}

// The pixel pitch follows from the lens that the camera was calibrated with. The sensor does not change with
// the lens. Where the lens of the calibration is unknown, it is taken to be the present one.
void takeCamera(const CalibrationLens& calibration, SharedScene& shared) {
  const SceneMessages& messages = shared.messages;
  if (!messages.camera) throw missing(topics::kColorInfo);
  const OpticsConstPtr optics = messages.optics ? messages.optics : calibration.optics;
  if (!optics) throw missing(topics::kOptics);
  const Camera camera = toCamera(*messages.camera, topics::kColorInfo);
  shared.scene.optics = toOptics(*optics);
  shared.scene.pixel_pitch_mm = calibration.pixel_pitch_mm;
  if (calibration.pixel_pitch_mm == 0 && calibration.optics)
    shared.scene.pixel_pitch_mm = calibration.optics->focal_length_mm / camera.fx;
  shared.scene.camera = camera;
}

}  // namespace

SharedScene toScene(const SceneMessages& messages, Mode mode, const cv::Size& frame,
                    const CalibrationLens& calibration) {
  SharedScene shared;
  shared.messages = messages;
  const bool is_paper = mode == Mode::kPaper;
  const auto check_region = [&](auto&) { requireRegion(*messages.camera, frame, topics::kColorInfo); };
  if (messages.camera && !attempt(shared, check_region, kBySharpness)) return shared;
  if (messages.labels) attempt(shared, takeLabels, is_paper ? kBySharpness : kNoLabels);
  const bool has_depth = messages.depth && attempt(shared, takeDepth, is_paper ? kNotPublished : kNotUsed);
  if (is_paper) return shared;
  if (has_depth) attempt(shared, takeMeasured, ": filled depth counts as measured");
  const auto take_camera = [&](SharedScene& scene) { takeCamera(calibration, scene); };
  if (messages.depth || messages.camera) attempt(shared, take_camera, kNotUsed);
  return shared;
}

// What is there is not replaced: the scene may read its memory.
bool joinLate(const SceneMessages& now, SharedScene& shared) {
  SceneMessages& messages = shared.messages;
  const bool are_new = now.labels && !messages.labels;
  if (are_new) messages.labels = now.labels;
  if (now.depth && !messages.depth) {
    messages.depth = now.depth;
    attempt(shared, takeDepth, kNotPublished);
  }
  if (now.camera) messages.camera = now.camera;
  return are_new && attempt(shared, takeLabels, kNoLabels);
}

}  // namespace all_in_focus
