// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace all_in_focus {

/// What a picture file says of itself, besides its pixels.
struct PhotoMetadata {
  cv::Size size;      ///< as stored; 0x0 where the format does not tell it
  std::string taken;  ///< EXIF time of exposure, "2026:05:01 12:00:00.25"; "" = unknown. Sorts like time.
  bool is_result = false;  ///< a program of this package wrote it
};

/// Never throws: what cannot be read is unknown. Call it from one thread at a time.
PhotoMetadata readPhotoMetadata(const std::string& path);

/// Notes in an encoded picture that this package made it, so that a later run does not take it for a frame.
/// EXIF holds the mark; where the format has no EXIF, false is returned and `data` stays as it is.
bool markAsResult(std::string& data);

/// The file beside a result whose format has no EXIF: it is the mark.
std::string markBeside(const std::string& path);

}  // namespace all_in_focus
