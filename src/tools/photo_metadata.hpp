// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace all_in_focus {

/// How EXIF says that a picture is to be turned and mirrored before it is shown, 1 to 8; 1 = not at all.
using Orientation = int;

/// What a picture file says of itself, besides its pixels.
struct PhotoMetadata {
  cv::Size size;      ///< as stored; 0x0 where the format does not tell it
  std::string taken;  ///< EXIF time of exposure, "2026:05:01 12:00:00.25"; "" = unknown. Sorts like time.
  Orientation orientation = 1;  ///< 1 where the file does not tell it
  bool is_result = false;       ///< a program of this package wrote it
  bool is_aligned = false;      ///< ... as a frame of --save-aligned
  std::string frames, options;  ///< of a result: see PhotoSource, frames separated by commas
};

/// Never throws: what cannot be read is unknown. Call it from one thread at a time.
PhotoMetadata readPhotoMetadata(const std::string& path);

/// Turns the picture as it is to be shown.
cv::Mat upright(const cv::Mat& image, Orientation orientation);
/// Its size then.
cv::Size uprightSize(const cv::Size& stored, Orientation orientation);

/// Where a result comes from.
struct PhotoSource {
  std::string reference;  ///< path of the frame whose EXIF data and colour profile it gets; "" = of none
  std::string frames;     ///< names, see namesText()
  Orientation orientation = 1;  ///< of the result's pixels
  std::string options;          ///< of the program
  bool is_aligned = false;      ///< it is no result, but an aligned frame
};

/// Names separated by commas.
std::string namesText(const std::vector<std::string>& names);

/// Notes in an encoded picture that this package made it, so that a later run does not take it for a frame,
/// and where it comes from. Exif.Image.Software holds the mark, Xmp.dc.source the names of the frames,
/// Xmp.xmp.CreatorTool the options. Where the format holds no EXIF data, false is returned and `data` stays
/// as it is.
bool markAsResult(std::string& data, const PhotoSource& source = {});

/// The file beside a result whose format has no EXIF: it is the mark.
std::string markBeside(const std::string& path);

}  // namespace all_in_focus
