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

/// What a stream was set to.
struct KinectMode {
  int width = 0, height = 0;  // pixels
  int fps = 0;
  double horizontal_fov = 0;  // rad; 0: the camera does not tell
  bool mirrored = false;      // it cannot be switched off (recordings)
};

/// An image as OpenNI2 delivers it; does not own its pixels.
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

/// Copies a frame into a message, never mirrored, without gaps between rows: depth as 16UC1 mm with the
/// invalid_values set to 0, IR and colour as mono16, mono8 or rgb8. Throws std::invalid_argument with
/// one line for people when the frame is not what the stream was set to, or lacks pixels.
sensor_msgs::ImagePtr toImage(const KinectFrame& frame, const std_msgs::Header& header,
                              const std::vector<int>& invalid_values);

}  // namespace all_in_focus
