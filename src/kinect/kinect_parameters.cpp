// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_parameters.hpp"

#include <opencv2/core.hpp>

namespace all_in_focus {
namespace {

constexpr double kMostSeconds = 3600;  // of every time: more is a mistake, much more than ROS can add
constexpr double kSlowestRate = 0.001;

void readNumber(const ros::NodeHandle& nh, const char* name, double least, double most, double& value,
                NodeMonitor& monitor) {
  double read = value;
  if (!nh.hasParam(name)) return;
  if (nh.getParam(name, read) && read >= least && read <= most) {
    value = read;
    return;
  }
  monitor.error(cv::format("%s must be a number from %g to %g: using %g", name, least, most, value));
}

// camera_info_manager accepts only URLs.
std::string toUrl(const std::string& file_or_url) {
  return !file_or_url.empty() && file_or_url[0] == '/' ? "file://" + file_or_url : file_or_url;
}

}  // namespace

KinectParameters readKinectParameters(const ros::NodeHandle& nh, NodeMonitor& monitor) {
  KinectParameters p;
  nh.getParam("device", p.device);
  readNumber(nh, "playback_rate", 0.0, 1000.0, p.playback.rate, monitor);
  if (p.playback.rate > 0 && p.playback.rate < kSlowestRate) {
    monitor.error("playback_rate must be 0 or at least 0.001: using 1");
    p.playback.rate = 1;
  }
  nh.getParam("repeat", p.playback.repeat);
  nh.getParam("single_step", p.playback.single_step);
  if (nh.hasParam("invalid_values") && !nh.getParam("invalid_values", p.invalid_values)) {
    monitor.error("invalid_values is not a list of integers (mm): using [0, 2047, 65535]");
  }
  readNumber(nh, "time_offset", -kMostSeconds, kMostSeconds, p.time_offset, monitor);
  readNumber(nh, "reconnect_period", 0.1, kMostSeconds, p.reconnect_period, monitor);
  readNumber(nh, "silence_timeout", 0.0, kMostSeconds, p.silence_timeout, monitor);
  double queue_size = p.queue_size;
  readNumber(nh, "queue_size", 1, 1000, queue_size, monitor);
  p.queue_size = static_cast<int>(queue_size);

  const std::string camera = nh.param("camera_name", std::string("kinect"));
  for (const KinectStream stream : kKinectStreams) {
    const char* const names[] = {"depth", "ir", "rgb"};
    const std::string name = names[indexOf(stream)];
    KinectStreamParameters& s = p.streams[indexOf(stream)];
    s.name = camera + "_" + name;
    s.frame_id = nh.param(name + "_frame_id", s.name + "_optical_frame");
    s.info_url = toUrl(nh.param(name + "_camera_info_url", std::string()));
  }
  return p;
}

}  // namespace all_in_focus
