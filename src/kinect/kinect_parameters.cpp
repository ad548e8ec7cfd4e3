// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_parameters.hpp"

#include "image_limit.hpp"
#include "parameters.hpp"

namespace all_in_focus {
namespace {

constexpr double kMostSeconds = 3600;  // of every time: more is a mistake, much more than ROS can add
constexpr double kSlowestRate = 0.001;

// camera_info_manager accepts only URLs.
std::string toUrl(const std::string& file_or_url) {
  return !file_or_url.empty() && file_or_url[0] == '/' ? "file://" + file_or_url : file_or_url;
}

}  // namespace

KinectParameters readKinectParameters(const ros::NodeHandle& nh, NodeStatus& status) {
  KinectParameters p;
  readParameter(nh, "device", p.device, status);
  readNumber(nh, "playback_rate", 0.0, 1000.0, p.playback.rate, status);
  if (p.playback.rate > 0 && p.playback.rate < kSlowestRate) {
    status.error("playback_rate must be 0 or at least 0.001: using 1");
    p.playback.rate = 1;
  }
  readParameter(nh, "repeat", p.playback.repeat, status);
  readInvalidValues(nh, p.invalid_values, status);
  readNumber(nh, "time_offset", -kMostSeconds, kMostSeconds, p.time_offset, status);
  readNumber(nh, "reconnect_period", 0.1, kMostSeconds, p.reconnect_period, status);
  readNumber(nh, "silence_timeout", 0.0, kMostSeconds, p.silence_timeout, status);
  readNumber(nh, "queue_size", 1, kMostWaiting, p.queue_size, status);

  std::string camera = "kinect";
  readParameter(nh, "camera_name", camera, status);
  for (const KinectStream stream : kKinectStreams) {
    const char* const names[] = {"depth", "ir", "rgb"};
    const std::string name = names[indexOf(stream)];
    KinectStreamParameters& s = p.streams[indexOf(stream)];
    s.name = camera + "_" + name;
    s.frame_id = s.name + "_optical_frame";
    readParameter(nh, name + "_frame_id", s.frame_id, status);
    readParameter(nh, name + "_camera_info_url", s.info_url, status);
    s.info_url = toUrl(s.info_url);
  }
  return p;
}

}  // namespace all_in_focus
