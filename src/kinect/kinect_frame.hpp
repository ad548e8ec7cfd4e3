// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <OniEnums.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace all_in_focus {

enum class KinectStream { kDepth, kIr, kColor };
constexpr KinectStream kKinectStreams[] = {KinectStream::kDepth, KinectStream::kIr, KinectStream::kColor};
constexpr std::size_t indexOf(KinectStream stream) {
  return static_cast<std::size_t>(stream);
}
const char* toString(KinectStream stream);  ///< "depth", "IR", "colour"

/// The settings of a stream.
struct KinectMode {
  int width = 0, height = 0;  // pixels
  int fps = 0;
  double horizontal_fov = 0;  // rad; 0: the camera does not report it
  bool mirrored = false;      // mirroring cannot be switched off (recordings)
};

/// An image as OpenNI2 delivers it. It does not own its pixels.
struct KinectFrame {
  KinectStream stream = KinectStream::kDepth;
  KinectMode mode;
  int index = 0;
  std::uint64_t device_us = 0;  // clock of the camera
  openni::PixelFormat format = openni::PIXEL_FORMAT_DEPTH_1_MM;
  int width = 0, height = 0;  // pixels
  int stride = 0;             // bytes from row to row
  const void* data = nullptr;
  std::size_t bytes = 0;  // at data
};

/// Copies a frame into a message without padding, and undoes mirroring. Depth becomes 16UC1 in mm with the
/// invalid_values set to 0; IR and colour become mono16, mono8 or rgb8. Throws std::invalid_argument with a
/// message of one line if the frame does not fit the settings of its stream, or lacks pixels.
sensor_msgs::ImagePtr toImage(const KinectFrame& frame, const std_msgs::Header& header,
                              const std::vector<int>& invalid_values);

}  // namespace all_in_focus
