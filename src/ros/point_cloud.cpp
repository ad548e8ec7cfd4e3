// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "point_cloud.hpp"

#include <sensor_msgs/point_cloud2_iterator.h>

#include <boost/make_shared.hpp>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "all_in_focus/scene_points.hpp"

namespace all_in_focus {

sensor_msgs::PointCloud2Ptr toPointCloud(const std_msgs::Header& header, const cv::Mat& bgr,
                                         const cv::Mat& mm, const core::Camera& camera) {
  if (bgr.type() != CV_8UC3 || mm.type() != CV_16UC1 || bgr.size() != mm.size())
    throw std::invalid_argument("a cloud needs a colour picture and depth of its size");
  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
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
    std::vector<cv::Vec3f> points(static_cast<std::size_t>(bgr.cols));
    for (int y = rows.start; y < rows.end; ++y) {
      core::scenePoints(mm, bgr.size(), camera, y, points.data());
      const auto* pixel = bgr.ptr<cv::Vec3b>(y);
      for (const cv::Vec3f& point : points) {
        for (int i = 0; i < 3; ++i) {
          place[i] = point[i];
          color[i] = (*pixel)[i];
        }
        ++place, ++color, ++pixel;
      }
    }
  });
  return cloud;
}

}  // namespace all_in_focus
