// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "point_cloud.hpp"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace all_in_focus {
namespace {

constexpr bool kIsBigEndian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
constexpr std::size_t kPointBytes = 3 * sizeof(float) + 3;
constexpr double kMmPerM = 1000;

// Place of pixel i of n among m pixels of the same picture.
double scaled(int i, int n, int m) {
  return (i + 0.5) * m / n - 0.5;
}

void append(float value, std::string& data) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  data.append(bytes, sizeof bytes);
}

void appendRow(const cv::Mat& image, const cv::Mat& depth, const core::Camera& camera, int y,
               std::string& data) {
  const auto* depths = depth.ptr<std::uint16_t>(cvRound(scaled(y, image.rows, depth.rows)));
  const auto* pixels = image.ptr<cv::Vec3b>(y);
  const double v = (scaled(y, image.rows, camera.size.height) - camera.cy) / camera.fy;
  for (int x = 0; x < image.cols; ++x) {
    const std::uint16_t mm = depths[cvRound(scaled(x, image.cols, depth.cols))];
    if (mm == 0) continue;
    const double z = mm / kMmPerM, u = (scaled(x, image.cols, camera.size.width) - camera.cx) / camera.fx;
    const cv::Point2d ray = camera.distorted() ? camera.undistort({u, v}) : cv::Point2d(u, v);
    if (!(std::abs(ray.x) + std::abs(ray.y) < 1e6)) continue;  // no lens sees there
    for (const double value : {ray.x * z, ray.y * z, z}) append(static_cast<float>(value), data);
    for (const int channel : {2, 1, 0}) data += static_cast<char>(pixels[x][channel]);
  }
}

}  // namespace

std::string pointCloudPly(const cv::Mat& image, const cv::Mat& depth, const core::Camera& camera) {
  std::vector<std::string> rows(static_cast<std::size_t>(image.rows));
  cv::parallel_for_({0, image.rows}, [&](const cv::Range& range) {
    for (int y = range.start; y < range.end; ++y)
      appendRow(image, depth, camera, y, rows[static_cast<std::size_t>(y)]);
  });
  std::size_t bytes = 0;
  for (const std::string& row : rows) bytes += row.size();
  std::string ply =
      std::string("ply\nformat binary_") + (kIsBigEndian ? "big" : "little") +
      "_endian 1.0\n"
      "comment all_in_focus: metres, in the colour camera's frame (X right, Y down, Z forward)\n"
      "element vertex " +
      std::to_string(bytes / kPointBytes) +
      "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
      "property uchar green\nproperty uchar blue\nend_header\n";
  ply.reserve(ply.size() + bytes);
  for (std::string& row : rows) {
    ply += row;
    std::string().swap(row);
  }
  return ply;
}

}  // namespace all_in_focus
