// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segment_markers.hpp"

#include <visualization_msgs/MarkerArray.h>

#include "all_in_focus/drawing.hpp"
#include "topics.hpp"

namespace all_in_focus {
namespace {

using visualization_msgs::Marker;

constexpr double kTextHeight = 0.02;  // of the distance: equally legible near and far

visualization_msgs::MarkerArray toMarkers(const CaptionSet& set, const Camera& camera) {
  visualization_msgs::MarkerArray array;
  Marker marker;
  marker.header = set.header;
  marker.pose.orientation.w = 1;
  marker.action = Marker::DELETEALL;  // there may be fewer segments than in the last image
  array.markers.push_back(marker);

  marker.ns = "segments";
  marker.type = Marker::TEXT_VIEW_FACING;
  marker.action = Marker::ADD;
  const std::vector<cv::Vec3b> colors = labelColors(set.labels);
  const auto pale = [](int value) {
    return static_cast<float>(2 * value + 255) / 765;
  };  // pure blue is not legible
  for (const RegionCaption& caption : set.captions) {
    const double z = caption.near_mm / 1e3;
    const cv::Point2d ray = camera.ray(caption.anchor);
    const cv::Vec3b& color = colors.at(caption.label);
    marker.id = caption.label;
    marker.text = caption.text;
    marker.pose.position.x = ray.x * z;
    marker.pose.position.y = ray.y * z;
    marker.pose.position.z = z;
    marker.scale.z = kTextHeight * z;
    marker.color.r = pale(color[2]);
    marker.color.g = pale(color[1]);
    marker.color.b = pale(color[0]);
    marker.color.a = 1;
    array.markers.push_back(marker);
  }
  return array;
}

}  // namespace

SegmentMarkers::SegmentMarkers(CallbackGuard& guard, NodeStatus& status)
    : guard_(guard),
      status_(status),
      info_input_(status.addInput(topics::kDepthInfo, Expect::kOptional, "start depth_preprocess")) {}

void SegmentMarkers::advertise(const ros::SubscriberStatusCallback& connect) {
  publisher_ = guard_.nh.advertise<visualization_msgs::MarkerArray>(status_.addOutput("segmentation/markers"),
                                                                    1, connect, connect);
}

void SegmentMarkers::listen(bool awake) {
  const bool want = awake && wanted();
  if (want && !info_subscriber_) {
    info_subscriber_ = guard_.subscribe<sensor_msgs::CameraInfo>(guard_.nh, info_input_, 1,
                                                                 [this](const auto& info) { onInfo(info); });
  } else if (!want && info_subscriber_) {
    info_subscriber_ = {};
    camera_.reset();  // may be out of date when the next subscriber comes
    waiting_.reset();
  }
}

void SegmentMarkers::publish(const CaptionSet& captions) {
  if (!wanted()) return;
  const bool second = waiting_ != nullptr;
  waiting_ = std::make_unique<CaptionSet>(captions);
  if (publishWaiting() || !second) return;
  status_.warn(
      "markers wait for " + status_.resolved(info_input_) +
      ": nothing came that fits the depth image; publish its camera's calibration there, or remap it");
}

void SegmentMarkers::onInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  try {
    camera_ = std::make_unique<Camera>(toCamera(*info, status_.resolved(info_input_)));
    publishWaiting();
  } catch (const std::exception& e) {
    camera_.reset();
    status_.error(e.what());
  }
}

bool SegmentMarkers::publishWaiting() {
  if (!waiting_ || !camera_ || camera_->size != waiting_->size) return false;
  publisher_.publish(toMarkers(*waiting_, *camera_));
  waiting_.reset();
  return true;
}

}  // namespace all_in_focus
