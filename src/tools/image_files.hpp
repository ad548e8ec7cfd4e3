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
/// or cut short (OpenCV decodes the rest of a truncated PNG as black without a word).
cv::Mat readColor(const std::string& path);

/// Depth map: 16-bit one-channel PNG, mm, 0 = unknown. Throws std::invalid_argument, also when no pixel is
/// known.
cv::Mat readDepth(const std::string& path);

/// Label map: 8- or 16-bit one-channel image as CV_32SC1. With unknown >= 0 that value becomes label 0 and
/// all others move out of its way; otherwise every distinct value is a region.
cv::Mat readLabelMap(const std::string& path, int unknown);

/// Labels as a 16-bit PNG holds them. Throws std::invalid_argument above 65535.
cv::Mat labels16(const cv::Mat& labels);

/// Files that appear all together or not at all: each is written beside its place under another name,
/// commit() moves them. Throws std::invalid_argument that names the file; 16-bit images need a format that
/// holds them (OpenCV writes the others with 8 bits without a word).
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
