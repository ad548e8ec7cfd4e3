// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "point_cloud.hpp"

#include <sensor_msgs/point_cloud2_iterator.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>

namespace all_in_focus {
namespace {

constexpr float kMPerMm = 1e-3F;
constexpr double kSteepest = 1e6;  // of a ray; no lens sees farther out

/// Place of pixel i of n among m pixels of the same picture.
double scaled(int i, int n, int m) {
  return (i + 0.5) * m / n - 0.5;
}

}  // namespace

sensor_msgs::PointCloud2Ptr toPointCloud(const std_msgs::Header& header, const cv::Mat& bgr,
                                         const cv::Mat& mm, const core::Camera& camera) {
  if (bgr.type() != CV_8UC3 || mm.type() != CV_16UC1 || bgr.size() != mm.size())
    throw std::invalid_argument("a cloud needs a colour picture and depth of its size");
  const auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  cloud->width = static_cast<std::uint32_t>(bgr.cols);
  cloud->height = static_cast<std::uint32_t>(bgr.rows);
  cloud->is_dense = 0;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2FieldsByString(2, "xyz", "rgb");
  cv::parallel_for_({0, bgr.rows}, [&](const cv::Range& rows) {
    sensor_msgs::PointCloud2Iterator<float> place(*cloud, "x");
    sensor_msgs::PointCloud2Iterator<std::uint8_t> color(*cloud, "b");
    place += rows.start * bgr.cols;
    color += rows.start * bgr.cols;
    for (int y = rows.start; y < rows.end; ++y) {
      const double v = (scaled(y, bgr.rows, camera.size.height) - camera.cy) / camera.fy;
      const auto* depth = mm.ptr<std::uint16_t>(y);
      const auto* pixel = bgr.ptr<cv::Vec3b>(y);
      for (int x = 0; x < bgr.cols; ++x, ++place, ++color) {
        for (int channel = 0; channel < 3; ++channel) color[channel] = pixel[x][channel];
        const double u = (scaled(x, bgr.cols, camera.size.width) - camera.cx) / camera.fx;
        const cv::Point2d ray = camera.distorted() ? camera.undistort({u, v}) : cv::Point2d(u, v);
        if (depth[x] == 0 || !(std::abs(ray.x) + std::abs(ray.y) < kSteepest)) {
          place[0] = place[1] = place[2] = std::numeric_limits<float>::quiet_NaN();
          continue;
        }
        place[2] = kMPerMm * static_cast<float>(depth[x]);
        place[0] = static_cast<float>(ray.x) * place[2];
        place[1] = static_cast<float>(ray.y) * place[2];
      }
    }
  });
  return cloud;
}

}  // namespace all_in_focus
