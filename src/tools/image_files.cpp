// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "image_files.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  throw std::invalid_argument(path + ": " + what);
}

cv::Mat decode(const std::string& path, int flags) {
  if (!fs::exists(path)) fail(path, "no such file");
  if (!fs::is_regular_file(path)) fail(path, "not a file");
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file && !file.eof()) fail(path, "cannot be read");
  const std::string head(bytes.begin(), bytes.begin() + std::min<std::size_t>(bytes.size(), 8));
  const std::string tail(bytes.end() - std::min<std::size_t>(bytes.size(), 12), bytes.end());
  if (head == "\x89PNG\r\n\x1a\n" && tail.find("IEND") == std::string::npos)
    fail(path, "PNG is cut short: copy it again");
  if (head.compare(0, 2, "\xff\xd8") == 0) {
    const std::string end = "\xff\xd9";
    // Cameras append data of their own after the end mark: it must be there, not be last.
    if (std::find_end(bytes.begin(), bytes.end(), end.begin(), end.end()) == bytes.end()) {
      fail(path, "JPEG is cut short: copy it again");
    }
  }
  const cv::Mat image = bytes.empty() ? cv::Mat() : cv::imdecode(bytes, flags);
  if (image.empty()) fail(path, "not an image that can be read");
  return image;
}

}  // namespace

cv::Mat readColor(const std::string& path) {
  return decode(path, cv::IMREAD_COLOR);
}

cv::Mat readDepth(const std::string& path) {
  const cv::Mat depth = decode(path, cv::IMREAD_UNCHANGED);
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
    if (unknown > 0) labels += 1;  // 0 is a region then
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

OutputFiles::~OutputFiles() {
  std::error_code ignored;
  for (const auto& file : files_) fs::remove(file.first, ignored);
}

// The ending stays last: it tells the encoder what to write.
std::string OutputFiles::reserve(const std::string& path) {
  const fs::path target(path);
  if (target.filename().empty() || fs::is_directory(target)) fail(path, "is a folder, not a file to write");
  if (target.has_parent_path() && !fs::is_directory(target.parent_path())) {
    fail(path, "the folder " + target.parent_path().string() + " does not exist");
  }
  const fs::path temporary =
      target.parent_path() / ("." + target.stem().string() + ".partial" + target.extension().string());
  files_.emplace_back(temporary.string(), path);
  return temporary.string();
}

void OutputFiles::addImage(const std::string& path, const cv::Mat& image) {
  if (path.empty()) return;
  const std::string temporary = reserve(path);
  bool written = false;
  try {
    written = cv::imwrite(temporary, image);
  } catch (const cv::Exception& e) {
    fail(path, "no image format has this ending (use .png)");
  }
  if (!written) fail(path, "cannot be written");
}

void OutputFiles::addText(const std::string& path, const std::string& text) {
  if (path.empty()) return;
  std::ofstream file(reserve(path));
  file << text;
  file.close();
  if (!file) fail(path, "cannot be written");
}

void OutputFiles::commit() {
  for (const auto& [temporary, path] : files_) fs::rename(temporary, path);
  files_.clear();
}

}  // namespace all_in_focus
