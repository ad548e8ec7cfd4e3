// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "image_files.hpp"

#include <jpeglib.h>  // needs stdio.h before it

#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "file_error.hpp"
#include "picture_reader.hpp"
#include "quiet_stderr.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

/// libjpeg's errors, which leave its functions by longjmp().
struct JpegErrors {
  jpeg_error_mgr base;  // the first member: libjpeg knows only this one
  jmp_buf failed;
};

void leaveJpeg(j_common_ptr jpeg) {
  longjmp(reinterpret_cast<JpegErrors*>(jpeg->err)->failed, 1);
}

// JPEG with colour at full resolution; OpenCV halves it, and before 4.7 cannot be told otherwise. Empty where
// it fails.
std::string encodeJpeg(const cv::Mat& image, int quality) {
  JpegErrors errors{};
  jpeg_compress_struct jpeg{};
  unsigned char* data = nullptr;
  unsigned long size = 0;
  jpeg.err = jpeg_std_error(&errors.base);
  errors.base.error_exit = leaveJpeg;
  if (setjmp(errors.failed) == 0) {
    jpeg_create_compress(&jpeg);
    jpeg_mem_dest(&jpeg, &data, &size);
    jpeg.image_width = static_cast<JDIMENSION>(image.cols);
    jpeg.image_height = static_cast<JDIMENSION>(image.rows);
    jpeg.input_components = image.channels();
    jpeg.in_color_space = image.channels() == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, quality, TRUE);
    for (int i = 0; i < jpeg.num_components; ++i)
      jpeg.comp_info[i].h_samp_factor = jpeg.comp_info[i].v_samp_factor = 1;
    jpeg_start_compress(&jpeg, TRUE);
    while (jpeg.next_scanline < jpeg.image_height) {
      auto* row = const_cast<unsigned char*>(image.ptr<unsigned char>(static_cast<int>(jpeg.next_scanline)));
      jpeg_write_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_compress(&jpeg);
  } else {
    size = 0;
  }
  jpeg_destroy_compress(&jpeg);
  std::string encoded(reinterpret_cast<const char*>(data), size);
  std::free(data);
  return encoded;
}

}  // namespace

cv::Mat readColor(const std::string& path, int page) {
  cv::Mat picture = readPicture(path, page);
  if (picture.type() == CV_8UC3) return picture;
  try {
    return toColor(toFrame(picture, whiteCode(picture.depth(), highestCode(path, page, picture))));
  } catch (const FileError&) {
    throw;
  } catch (const std::invalid_argument& e) {
    fail(path, e.what());
  }
}

cv::Mat readHalfColor(const std::string& path, int page) {
  const std::string kind = ending(path);
  if (kind == ".jpg" || kind == ".jpeg")
    return decodePicture(path, cv::IMREAD_REDUCED_COLOR_2 | cv::IMREAD_IGNORE_ORIENTATION);
  const cv::Mat whole = readColor(path, page);
  cv::Mat half;
  cv::resize(whole, half, {(whole.cols + 1) / 2, (whole.rows + 1) / 2}, 0, 0, cv::INTER_AREA);
  return half;
}

cv::Mat readDepth(const std::string& path, const std::vector<int>& invalid_values) {
  cv::Mat depth = decodePicture(path, cv::IMREAD_UNCHANGED);
  if (depth.type() != CV_16UC1) fail(path, "depth must be a 16-bit image of one channel, in mm");
  for (const int value : invalid_values) {
    if (value != 0) depth.setTo(0, depth == value);
  }
  if (cv::countNonZero(depth) == 0) fail(path, "depth is unknown (0) at every pixel");
  return depth;
}

std::vector<int> parseInvalidValues(const std::string& text) {
  std::vector<int> values;
  std::istringstream list(text);
  for (std::string part; std::getline(list, part, ',');) {
    const bool digits = !part.empty() && part.find_first_not_of("0123456789") == std::string::npos;
    if (!digits || part.size() > 5 || std::stoi(part) > 65535) {
      throw std::invalid_argument("--invalid-values: '" + text +
                                  "' is not a list of mm from 0 to 65535, as in 0,65535");
    }
    values.push_back(std::stoi(part));
  }
  return values;
}

cv::Mat readLabelMap(const std::string& path, int unknown) {
  const cv::Mat image = decodePicture(path, cv::IMREAD_UNCHANGED);
  if (image.channels() != 1 || (image.depth() != CV_8U && image.depth() != CV_16U)) {
    fail(path, "a label map must be an 8- or 16-bit image of one channel");
  }
  cv::Mat labels;
  image.convertTo(labels, CV_32S);
  if (unknown >= 0) {
    const cv::Mat is_unknown = labels == unknown;
    if (unknown > 0) labels += 1;  // value 0 is a region, and must not become unknown
    labels.setTo(0, is_unknown);
  }
  return labels;
}

cv::Mat labels16(const cv::Mat& labels) {
  double greatest = 0;
  cv::minMaxLoc(labels, nullptr, &greatest);
  if (greatest > 65535) {
    throw std::invalid_argument(
        "labels: " + std::to_string(static_cast<int>(greatest)) +
        " regions do not fit a 16-bit PNG (65535 at most): smooth the depth or use wider optics");
  }
  cv::Mat out;
  labels.convertTo(out, CV_16U);
  return out;
}

bool holdsSixteenBits(const std::string& path) {
  static const std::set<std::string> wide = {"", ".png", ".tif", ".tiff"};
  return wide.count(ending(path)) > 0;
}

std::string encodeImage(const std::string& path, const cv::Mat& image, int quality) {
  if (image.depth() == CV_16U && !holdsSixteenBits(path))
    fail(path, "16-bit values do not fit this format (use .png)");
  if (ending(path) == ".jpg" || ending(path) == ".jpeg") {
    std::string jpeg = encodeJpeg(image, quality);
    if (jpeg.empty()) fail(path, "too large for a JPEG (65500 pixels a side at most), or memory is short");
    return jpeg;
  }
  std::vector<unsigned char> data;
  try {
    const QuietStderr quiet;
    std::vector<int> options;
    if (ending(path) == ".webp") options = {cv::IMWRITE_WEBP_QUALITY, quality};
    cv::imencode(fs::path(path).extension().string(), image, data, options);
  } catch (const cv::Exception&) {
    data.clear();
  }
  if (data.empty()) fail(path, "no image format has this ending (use .png)");
  return {data.begin(), data.end()};
}

}  // namespace all_in_focus
