// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "point_cloud.hpp"

#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

#include "all_in_focus/scene_points.hpp"

namespace all_in_focus {
namespace {

constexpr bool kIsBigEndian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
constexpr std::size_t kPointBytes = 3 * sizeof(float) + 3;

void append(float value, std::string& data) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  data.append(bytes, sizeof bytes);
}

void appendRow(const cv::Vec3b* pixels, const std::vector<cv::Vec3f>& points, std::string& data) {
  for (std::size_t x = 0; x < points.size(); ++x) {
    if (std::isnan(points[x][2])) continue;
    for (const int axis : {0, 1, 2}) append(points[x][axis], data);
    for (const int channel : {2, 1, 0}) data += static_cast<char>(pixels[x][channel]);
  }
}

}  // namespace

std::string pointCloudPly(const cv::Mat& image, const cv::Mat& depth, const core::Camera& camera) {
  std::vector<std::string> rows(static_cast<std::size_t>(image.rows));
  cv::parallel_for_({0, image.rows}, [&](const cv::Range& range) {
    std::vector<cv::Vec3f> points(static_cast<std::size_t>(image.cols));
    for (int y = range.start; y < range.end; ++y) {
      core::scenePoints(depth, image.size(), camera, y, points.data());
      appendRow(image.ptr<cv::Vec3b>(y), points, rows[static_cast<std::size_t>(y)]);
    }
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
