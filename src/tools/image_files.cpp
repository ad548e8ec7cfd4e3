// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "image_files.hpp"

#include <jpeglib.h>  // needs stdio.h before it

#include <algorithm>
#include <cctype>
#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "file_error.hpp"
#include "quiet_stderr.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

bool startsWith(const std::string& data, const char* mark) {
  return data.rfind(mark, 0) == 0;
}

bool isWholePng(const std::string& data) {
  return data.find("IEND", data.size() - std::min<std::size_t>(data.size(), 12)) != std::string::npos;
}

// Looks for the end mark behind the beginning of the image data: thumbnails before it have end marks of their
// own, and cameras append data after it.
bool isWholeJpeg(const std::string& data) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(data[i]); };
  std::size_t at = 2;
  while (at + 4 <= data.size() && byte(at) == 0xff) {
    if (byte(at + 1) == 0xff) {
      ++at;  // padding
    } else if (byte(at + 1) == 0xda) {
      return data.find("\xff\xd9", at) != std::string::npos;
    } else {
      at += 2 + (byte(at + 2) << 8 | byte(at + 3));
    }
  }
  return false;
}

/// The numbers in the bytes of a TIFF file.
class TiffNumbers {
 public:
  explicit TiffNumbers(std::string& data) : data_(data), big_endian_(startsWith(data, "MM")) {}

  std::uint64_t size() const { return data_.size(); }
  /// bytes: that the number has. It lies in the file.
  std::uint64_t get(std::uint64_t at, int bytes) const {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i)
      value = value << 8 | static_cast<unsigned char>(data_[at + (big_endian_ ? i : bytes - 1 - i)]);
    return value;
  }
  void set(std::uint64_t at, std::uint8_t value) {  // of two bytes
    data_[at + (big_endian_ ? 0 : 1)] = 0;
    data_[at + (big_endian_ ? 1 : 0)] = static_cast<char>(value);
  }

 private:
  std::string& data_;
  const bool big_endian_;
};

// OpenCV turns a TIFF as its first page says, whatever the flags are: the page is made to say "not at all".
void keepTiffAsStored(std::string& data) {
  constexpr std::uint64_t kOrientation = 274, kClassic = 42, kBig = 43;
  constexpr std::size_t kSmallest = 20;  // bytes: an entry of the longer kind
  if ((!startsWith(data, "II") && !startsWith(data, "MM")) || data.size() < kSmallest) return;
  TiffNumbers tiff(data);
  const std::uint64_t version = tiff.get(2, 2);
  if (version != kClassic && version != kBig) return;
  const bool big = version == kBig;
  const int offset_bytes = big ? 8 : 4, count_bytes = big ? 8 : 2, entry_bytes = big ? 20 : 12;
  std::uint64_t at = tiff.get(big ? 8 : 4, offset_bytes);
  if (at > tiff.size() - count_bytes) return;
  std::uint64_t count = tiff.get(at, count_bytes);
  for (at += count_bytes; count > 0 && at <= tiff.size() - entry_bytes; --count, at += entry_bytes) {
    if (tiff.get(at, 2) == kOrientation) tiff.set(at + entry_bytes - offset_bytes, 1);
  }
}

std::string readFile(const std::string& path) {
  if (!fs::exists(path)) fail(path, "no such file");
  if (!fs::is_regular_file(path)) fail(path, "not a file");
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : -1;
  std::string data(size > 0 ? size : 0, '\0');
  if (size < 0 || !file.seekg(0).read(data.data(), size)) fail(path, "cannot be read");
  return data;
}

cv::Mat decode(const std::string& path, int flags) {
  std::string data = readFile(path);
  if (startsWith(data, "\x89PNG\r\n\x1a\n") && !isWholePng(data))
    fail(path, "PNG is cut short: copy it again");
  if (startsWith(data, "\xff\xd8") && !isWholeJpeg(data)) fail(path, "JPEG is cut short: copy it again");
  keepTiffAsStored(data);
  cv::Mat image;
  if (!data.empty()) {
    const QuietStderr quiet;
    try {
      image = cv::imdecode(cv::Mat(1, static_cast<int>(data.size()), CV_8UC1, data.data()), flags);
    } catch (const cv::Exception&) {
    }
  }
  if (image.empty()) fail(path, "not an image that can be read");
  return image;
}

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

std::string ending(const std::string& path) {
  std::string ending = fs::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return ending;
}

cv::Mat readColor(const std::string& path) {
  return decode(path, cv::IMREAD_COLOR |
                          cv::IMREAD_IGNORE_ORIENTATION);  // not rotated: the calibration is of the sensor
}

cv::Mat readHalfColor(const std::string& path) {
  return decode(path, cv::IMREAD_REDUCED_COLOR_2 | cv::IMREAD_IGNORE_ORIENTATION);
}

cv::Mat readDepth(const std::string& path, const std::vector<int>& invalid_values) {
  cv::Mat depth = decode(path, cv::IMREAD_UNCHANGED);
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
  const cv::Mat image = decode(path, cv::IMREAD_UNCHANGED);
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

std::string encodeImage(const std::string& path, const cv::Mat& image, int quality) {
  static const std::set<std::string> wide = {".png", ".tif", ".tiff"};
  if (image.depth() == CV_16U && wide.count(ending(path)) == 0) {
    fail(path, "16-bit values do not fit this format (use .png)");
  }
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
