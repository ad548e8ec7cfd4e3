// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/image_transport.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

#include "kinect_calibration.hpp"
#include "kinect_clock.hpp"
#include "kinect_frame.hpp"
#include "kinect_parameters.hpp"
#include "node_monitor.hpp"

namespace all_in_focus {

/// One stream of the camera as it appears in ROS: images, camera_info, stamps, counts. All methods but the
/// constructor belong to one thread.
class KinectOutput {
 public:
  using Clock = std::chrono::steady_clock;

  /// on_connect: called whenever listeners come or go, from any thread.
  KinectOutput(KinectStream stream, const ros::NodeHandle& nh, const KinectParameters& parameters,
               NodeMonitor& monitor, const std::function<void()>& on_connect);

  KinectStream stream() const { return stream_; }
  const std::string& topic() const { return topic_; }
  bool isWanted() const { return publisher_.getNumSubscribers() > 0; }

  /// The stream was started (again): its clock may have changed meanwhile. rate: of a recording, see
  /// KinectClock.
  void begin(double rate);
  /// Since begin() or the last image, good or bad.
  Clock::duration silence() const { return Clock::now() - last_arrival_; }
  void publish(const KinectFrame& frame);

 private:
  ros::Time stampOf(const KinectFrame& frame);
  void countLost(const KinectFrame& frame);
  void report(const KinectMode& mode);

  const KinectStream stream_;
  const KinectParameters& parameters_;
  const KinectStreamParameters& of_stream_;
  NodeMonitor& monitor_;
  std::string topic_;
  KinectCalibration calibration_;
  image_transport::CameraPublisher publisher_;

  KinectClock clock_;
  Clock::time_point last_arrival_ = Clock::now();
  int last_index_ = 0;
  std::uint64_t published_ = 0, reported_ = 0;
  Clock::time_point reported_at_;
};

}  // namespace all_in_focus
