// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

namespace all_in_focus {

/// ".png" of "folder/Name.PNG".
std::string ending(const std::string& path);

/// Colour image, CV_8UC3 BGR. Throws std::invalid_argument that names the file when it is missing, no image,
/// or cut short (OpenCV would decode the rest of a truncated PNG as black without an error).
cv::Mat readColor(const std::string& path);

/// Depth map: 16-bit one-channel PNG, mm, 0 = unknown. Throws std::invalid_argument, also when no pixel is
/// known.
cv::Mat readDepth(const std::string& path);

/// Label map: 8- or 16-bit image of one channel, as CV_32SC1. Every distinct value is a region. With unknown
/// >= 0 that value becomes label 0 instead, and if 0 was a region, all other labels grow by one. Throws
/// std::invalid_argument that names the file.
cv::Mat readLabelMap(const std::string& path, int unknown);

/// Labels as CV_16UC1, for a 16-bit PNG. Throws std::invalid_argument if one exceeds 65535.
cv::Mat labels16(const cv::Mat& labels);

/// Output files that appear all together or not at all: each is written under a temporary name in its folder,
/// and commit() renames them. Throws std::invalid_argument that names the file, also when the format of a
/// 16-bit image has only 8 bits, which OpenCV would write without a warning.
class OutputFiles {
 public:
  ~OutputFiles();  ///< removes what was not committed
  void addImage(const std::string& path, const cv::Mat& image);
  void addText(const std::string& path, const std::string& text);
  void commit();

 private:
  std::string reserve(const std::string& path);
  std::vector<std::pair<std::string, std::string>> files_;  ///< temporary name, final name
};

}  // namespace all_in_focus
