// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "stack_reader.hpp"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>

#include "file_error.hpp"
#include "image_files.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

bool isImage(const fs::path& path) {
  static const std::set<std::string> endings = {".png",  ".jpg", ".jpeg", ".tif",
                                                ".tiff", ".bmp", ".ppm",  ".webp"};
  return path.filename().string()[0] != '.' && endings.count(ending(path.string())) > 0;
}

// True if numbers at the end of the names have different lengths: name order then puts 10.png before 2.png.
bool mixesNumberLengths(const std::vector<std::string>& names) {
  std::set<std::size_t> lengths;
  for (const std::string& name : names) {
    const std::size_t dot = name.rfind('.');
    std::size_t begin = dot;
    while (begin > 0 && std::isdigit(static_cast<unsigned char>(name[begin - 1]))) --begin;
    if (begin < dot) lengths.insert(dot - begin);
  }
  return lengths.size() > 1;
}

// Refuses an AVI that is shorter than its header says.
void requireWholeAvi(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  unsigned char head[12] = {};
  file.read(reinterpret_cast<char*>(head), sizeof head);
  if (std::string(head, head + 4) != "RIFF" || std::string(head + 8, head + 12) != "AVI ") return;
  const std::uint64_t length = head[4] | head[5] << 8 | head[6] << 16 | std::uint64_t{head[7]} << 24;
  if (fs::file_size(path) < length + 8) fail(path, "video is cut short: copy it again");
}

}  // namespace

StackReader::StackReader(const std::string& path) : path_(path) {
  if (fs::is_directory(path)) {
    for (const auto& entry : fs::directory_iterator(path)) {
      if (entry.is_regular_file() && isImage(entry.path()))
        names_.push_back(entry.path().filename().string());
    }
    if (names_.empty()) fail(path, "the folder holds no image");
    std::sort(names_.begin(), names_.end());
    if (mixesNumberLengths(names_))
      warning_ = path + ": numbers of different length, read in name order (10 before 2)";
    images_ = std::make_unique<ReadAhead>(
        static_cast<int>(names_.size()),
        [folder = fs::path(path), names = names_](int i) { return readColor((folder / names[i]).string()); });
    return;
  }
  if (!fs::is_regular_file(path)) fail(path, "no such folder or video");
  // OpenCV would open it as a video, together with the images numbered after it.
  if (isImage(path)) fail(path, "a single image: give its folder, or a video");
  requireWholeAvi(path);
  open();
}

void StackReader::open() {
  try {
    video_.open(path_, cv::CAP_FFMPEG);
  } catch (const cv::Exception&) {
  }
  if (!video_.isOpened()) fail(path_, "not a video that can be read");
}

bool StackReader::next(cv::Mat& frame) {
  if (!names_.empty()) {
    if (read_ == static_cast<int>(names_.size())) {
      frame.release();  // what follows may need the memory
      return false;
    }
    images_->get(read_++, frame);
    return true;
  }
  if (video_.read(frame) && !frame.empty()) {
    ++read_;
    return true;
  }
  requireWhole();
  return false;
}

void StackReader::rewind() {
  read_ = 0;
  if (names_.empty()) open();
}

int StackReader::count() {
  if (!names_.empty()) return static_cast<int>(names_.size());
  if (count_ < 0) {
    rewind();
    while (video_.grab()) ++read_;
    requireWhole();
    count_ = read_;
    rewind();
  }
  return count_;
}

cv::Mat StackReader::glance() {
  cv::Mat frame;
  try {
    if (!names_.empty()) return readHalfColor((fs::path(path_) / names_[names_.size() / 2]).string());
    const int middle = count() / 2;
    for (int i = 0; i < middle; ++i) video_.grab();
    video_.read(frame);
    rewind();
  } catch (const std::invalid_argument&) {
    // The error is reported when the frame is read in its turn.
  }
  return frame;
}

void StackReader::requireWhole() const {
  if (read_ == 0) fail(path_, "the video holds no frame");
  // Containers often report one frame too many.
  const double reported = video_.get(cv::CAP_PROP_FRAME_COUNT);
  if (reported - read_ > std::max(1.0, 0.01 * reported)) {
    fail(path_, "video is cut short: " + std::to_string(read_) + " of " +
                    std::to_string(static_cast<int>(reported)) + " frames can be read");
  }
}

std::string StackReader::current() const {
  return names_.empty() || read_ == 0 ? path_ : (fs::path(path_) / names_[read_ - 1]).string();
}

}  // namespace all_in_focus
