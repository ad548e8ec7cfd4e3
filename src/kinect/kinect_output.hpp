// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/image_transport.h>

#include <chrono>
#include <cstdint>
#include <string>

#include "kinect_calibration.hpp"
#include "kinect_clock.hpp"
#include "kinect_frame.hpp"
#include "kinect_parameters.hpp"
#include "node_status.hpp"

namespace all_in_focus {

/// Publishes one stream of the camera: images and camera_info, with stamps and statistics. Call all methods
/// but the constructor from one thread.
class KinectOutput {
 public:
  using Clock = std::chrono::steady_clock;

  KinectOutput(KinectStream stream, const ros::NodeHandle& nh, const KinectParameters& parameters,
               NodeStatus& status);

  KinectStream stream() const { return stream_; }
  const std::string& topic() const { return topic_; }
  bool isWanted() const { return publisher_.getNumSubscribers() > 0; }

  /// Call when the stream was started: its clock may have changed. rate: see KinectClock.
  void begin(double rate);
  /// Time since begin() or the last image, good or bad.
  Clock::duration silence() const { return Clock::now() - last_arrival_; }
  void publish(const KinectFrame& frame);

 private:
  void publishAs(std_msgs::Header& header, const KinectFrame& frame);
  ros::Time stampOf(const KinectFrame& frame);
  void countLost(const KinectFrame& frame);
  void report(const KinectMode& mode);

  const KinectStream stream_;
  const KinectParameters& parameters_;
  const KinectStreamParameters& of_stream_;
  NodeStatus& status_;
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
