// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "image_files.hpp"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <set>
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

cv::Mat readDepth(const std::string& path) {
  cv::Mat depth = decode(path, cv::IMREAD_UNCHANGED);
  if (depth.type() != CV_16UC1) fail(path, "depth must be a 16-bit image of one channel, in mm");
  if (cv::countNonZero(depth) == 0) fail(path, "depth is unknown (0) at every pixel");
  return depth;
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

std::string encodeImage(const std::string& path, const cv::Mat& image) {
  static const std::set<std::string> wide = {".png", ".tif", ".tiff"};
  if (image.depth() == CV_16U && wide.count(ending(path)) == 0) {
    fail(path, "16-bit values do not fit this format (use .png)");
  }
  std::vector<unsigned char> data;
  try {
    const QuietStderr quiet;
    cv::imencode(fs::path(path).extension().string(), image, data);
  } catch (const cv::Exception&) {
    data.clear();
  }
  if (data.empty()) fail(path, "no image format has this ending (use .png)");
  return {data.begin(), data.end()};
}

}  // namespace all_in_focus
