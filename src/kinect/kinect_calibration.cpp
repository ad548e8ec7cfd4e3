// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_calibration.hpp"

#include <sensor_msgs/distortion_models.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <opencv2/core.hpp>

namespace all_in_focus {
namespace {

constexpr double kDegree = M_PI / 180;
constexpr double kKinectDepthFov = 58.5 * kDegree, kKinectColorFov = 62.0 * kDegree;

bool isPossible(double fov) {
  return fov > 1 * kDegree && fov < 179 * kDegree;
}

}  // namespace

sensor_msgs::CameraInfo cameraInfoOf(KinectStream stream, const KinectMode& mode) {
  const double kinect_fov = stream == KinectStream::kColor ? kKinectColorFov : kKinectDepthFov;
  const double fov = isPossible(mode.horizontal_fov) ? mode.horizontal_fov : kinect_fov;
  const double f = mode.width / 2.0 / std::tan(fov / 2);
  const double cx = (mode.width - 1) / 2.0, cy = (mode.height - 1) / 2.0;

  sensor_msgs::CameraInfo info;
  info.width = mode.width;
  info.height = mode.height;
  info.distortion_model = sensor_msgs::distortion_models::PLUMB_BOB;
  info.D.assign(5, 0.0);
  info.K = {f, 0, cx, 0, f, cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1, 0};
  return info;
}

KinectCalibration::KinectCalibration(KinectStream stream, const ros::NodeHandle& nh,
                                     const KinectStreamParameters& parameters, NodeStatus& status)
    : stream_(stream),
      parameters_(parameters),
      status_(status),
      manager_(nh, parameters.name, parameters.info_url) {}

sensor_msgs::CameraInfoPtr KinectCalibration::cameraInfo(const KinectMode& mode) {
  auto info = boost::make_shared<sensor_msgs::CameraInfo>(manager_.getCameraInfo());
  const bool calibrated = info->K[0] != 0;
  if (calibrated && static_cast<int>(info->width) == mode.width &&
      static_cast<int>(info->height) == mode.height) {
    warned_.clear();
    return info;
  }
  const sensor_msgs::CameraInfo guess = cameraInfoOf(stream_, mode);
  const std::string why = calibrated
                              ? cv::format(": the calibration is for %ux%u pixels, the images have %dx%d",
                                           info->width, info->height, mode.width, mode.height)
                              : " is not calibrated";
  const std::string warning = parameters_.name + why +
                              cv::format(
                                  ": camera_info comes from the field of view, fx = fy = %ld pixels "
                                  "(calibrate, or give the calibration as *_camera_info_url)",
                                  std::lround(guess.K[0]));
  if (warning != warned_) status_.warn(warning);
  warned_ = warning;
  *info = guess;
  return info;
}

}  // namespace all_in_focus
