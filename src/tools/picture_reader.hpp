// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <set>
#include <string>

namespace all_in_focus {

/// Endings of the names of pictures: those that every program reads, those that readPicture() reads, camera
/// raw files and others, whether they can be read or not.
const std::set<std::string>& plainEndings();
const std::set<std::string>& readableEndings();
const std::set<std::string>& rawEndings();
const std::set<std::string>& otherEndings();

/// ".png" of "folder/Name.PNG".
std::string ending(const std::string& path);

/// How many pages of that file are pictures: of a TIFF maybe several, else 1.
int countPages(const std::string& path);

/// The bytes of a picture file, decoded as OpenCV's flags say. Throws std::invalid_argument that names the
/// file when it is missing, no image, or cut short (OpenCV would decode the rest of a truncated PNG as black
/// without an error).
cv::Mat decodePicture(const std::string& path, int flags, int page = 0);

/// A picture in BGR order as it is stored, not turned: CV_8U, CV_16U or CV_32F; three channels, or four where
/// some pixels are transparent. Camera raw files are developed: as shot, 16 bits, sRGB. Throws like
/// decodePicture().
cv::Mat readPicture(const std::string& path, int page = 0);

/// Whether readPicture() may return more than 8 bits whose highest code is to be found out; looks at the
/// beginning of the file.
bool hasOpenRange(const std::string& path);

/// The highest code of a picture, or that which its file names.
double highestCode(const std::string& path, int page, const cv::Mat& picture);

/// The code of white in pictures whose highest code is that: 12-bit cameras write 16-bit files, and float
/// files hold 0..1 or 0..255. Throws std::invalid_argument where float codes are neither.
double whiteCode(int depth, double highest);

/// A picture as a frame: CV_8U, or CV_16U in which 65535 is white.
cv::Mat toFrame(const cv::Mat& picture, double white);

/// A frame as CV_8UC3.
cv::Mat toColor(const cv::Mat& frame);

}  // namespace all_in_focus
