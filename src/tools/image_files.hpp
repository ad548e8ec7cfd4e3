// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "picture_reader.hpp"

namespace all_in_focus {

/// Colour picture, CV_8UC3 BGR, see readPicture().
cv::Mat readColor(const std::string& path, int page = 0);

/// The same at half the width and height, decoded faster where the format allows it.
cv::Mat readHalfColor(const std::string& path, int page = 0);

/// What sensors write besides 0 where they have measured nothing: the highest value of 16 bits.
inline const std::vector<int> kInvalidDepths{0, 65535};  // mm

/// Depth map: 16-bit one-channel PNG, mm, 0 = unknown; so are the invalid values, which become 0. Throws
/// std::invalid_argument, also when no pixel is known.
cv::Mat readDepth(const std::string& path, const std::vector<int>& invalid_values = kInvalidDepths);

/// Parses whole numbers separated by commas, "0,65535". Throws std::invalid_argument.
std::vector<int> parseInvalidValues(const std::string& text);

/// Label map: 8- or 16-bit image of one channel, as CV_32SC1. Every distinct value is a region. With unknown
/// >= 0 that value becomes label 0 instead, and if 0 was a region, all other labels grow by one. Throws
/// std::invalid_argument that names the file.
cv::Mat readLabelMap(const std::string& path, int unknown);

/// Labels as CV_16UC1, for a 16-bit PNG. Throws std::invalid_argument if one exceeds 65535.
cv::Mat labels16(const cv::Mat& labels);

constexpr int kDefaultQuality = 95;

/// Whether pictures with the ending of that path can have 16 bits; "" stands for PNG.
bool holdsSixteenBits(const std::string& path);

/// The image in the format of the path's ending. quality: of JPEG and lossy WebP, 1 to 100; JPEG keeps colour
/// at full resolution (4:4:4). Throws std::invalid_argument that names the path if no format has it, or one
/// with 8 bits for a 16-bit image, which OpenCV would write without a warning.
std::string encodeImage(const std::string& path, const cv::Mat& image, int quality = kDefaultQuality);

}  // namespace all_in_focus
