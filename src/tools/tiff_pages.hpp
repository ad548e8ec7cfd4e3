// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace all_in_focus {

/// What the directory of one page of a TIFF file says.
struct TiffPage {
  std::uint64_t at = 0;                     ///< offset of the directory in the file
  std::vector<std::uint64_t> orientations;  ///< offsets of the values that tell how to turn the picture
  cv::Size size;
  int bits = 1;     ///< of a sample
  int highest = 0;  ///< code that it names, as OpenCV decodes it; 0 = none
  bool has_alpha = false;
};

/// The pages of a TIFF file that are pictures as large as the first one, but no thumbnails. Of any other
/// file, or a broken one: those that can be found, maybe none. Where several pages are followed by one that
/// was cut off, a page of no size stands for it.
std::vector<TiffPage> readTiffPages(const std::string& path);

/// Makes the bytes of a TIFF file begin with that page and say that it need not be turned: OpenCV reads the
/// first page only, and turns it whatever it is told.
void showTiffPage(std::string& data, const TiffPage& page);

}  // namespace all_in_focus
