// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bracket_scene.hpp"

#include <sensor_msgs/image_encodings.h>

#include <stdexcept>

#include "topics.hpp"

namespace all_in_focus {
namespace {

constexpr const char* kNotUsed = ": depth and lens data are not used";
constexpr const char* kNotPublished = ": the result has no depth";

std::invalid_argument missing(const char* topic) {
  return std::invalid_argument(std::string("no ") + topic + " in time");
}

// Returns whether it could be taken. If not, a warning tells of it.
template <typename Take>
bool attempt(SharedScene& shared, const Take& take, const char* effect) {
  try {
    take();
    return true;
  } catch (const std::exception& e) {
    shared.warnings.push_back(oneLine(e.what()) + effect);
    return false;
  }
}

void takeLabels(const SceneMessages& messages, SharedScene& shared) {
  shared.labels = cv_bridge::toCvShare(messages.labels, sensor_msgs::image_encodings::TYPE_32SC1);
  shared.scene.labels = shared.labels->image;
}

void takeDepth(const SceneMessages& messages, SharedScene& shared) {
  shared.depth = toDepth(messages.depth, {}, topics::kDepth);
}

void takeMeasured(const SceneMessages& messages, SharedScene& shared) {
  if (!messages.measured) throw missing(topics::kMeasured);
  shared.measured = toDepth(messages.measured, {}, topics::kMeasured);
  shared.scene.measured = shared.measured.mm;
}

// The pixel pitch follows from the lens that the camera was calibrated with. The sensor does not change with
// the lens. Where the lens of the calibration is unknown, it is taken to be the present one.
void takeCamera(const SceneMessages& messages, const CalibrationLens& calibration, SharedScene& shared) {
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
  const auto take = [&](const auto& part, const char* effect) { return attempt(shared, part, effect); };
  const bool is_paper = mode == Mode::kPaper;
  if (messages.camera && !take([&] { requireRegion(*messages.camera, frame, topics::kColorInfo); },
                               ": fused by sharpness alone"))
    return shared;
  if (messages.labels)
    take([&] { takeLabels(messages, shared); },
         is_paper ? ": fused by sharpness alone" : ": labels are not used");
  const bool has_depth =
      messages.depth && take([&] { takeDepth(messages, shared); }, is_paper ? kNotPublished : kNotUsed);
  if (is_paper) return shared;
  shared.scene.depth = shared.depth.mm;
  if (has_depth) take([&] { takeMeasured(messages, shared); }, ": filled depth counts as measured");
  if (messages.depth || messages.camera) take([&] { takeCamera(messages, calibration, shared); }, kNotUsed);
  return shared;
}

void joinLate(const SceneMessages& before, const SceneMessages& now, SharedScene& shared) {
  if (now.labels && !before.labels)
    attempt(
        shared, [&] { takeLabels(now, shared); }, ": labels are not used");
  if (now.depth && !before.depth)
    attempt(
        shared, [&] { takeDepth(now, shared); }, kNotPublished);
}

}  // namespace all_in_focus
