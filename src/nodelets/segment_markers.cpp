// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "segment_markers.hpp"

#include "all_in_focus/drawing.hpp"

namespace all_in_focus {
namespace {

using visualization_msgs::Marker;

constexpr double kTextHeight = 0.02;  // of the distance: equally legible near and far

}  // namespace

visualization_msgs::MarkerArray toMarkers(const CaptionSet& set, const core::Camera& camera) {
  visualization_msgs::MarkerArray array;
  Marker marker;
  marker.header = set.header;
  marker.pose.orientation.w = 1;
  marker.action = Marker::DELETEALL;  // there may be fewer segments than in the last image
  array.markers.push_back(marker);

  marker.ns = "segments";
  marker.type = Marker::TEXT_VIEW_FACING;
  marker.action = Marker::ADD;
  const std::vector<cv::Vec3b> colors = core::labelColors(set.labels);
  const auto pale = [](int value) {
    return static_cast<float>(2 * value + 255) / 765;
  };  // pure blue is not legible
  for (const core::RegionCaption& caption : set.captions) {
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

}  // namespace all_in_focus
