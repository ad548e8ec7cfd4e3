// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "stack_reader.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <stdexcept>

#include "file_error.hpp"
#include "image_files.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

// Refuses an AVI that is shorter than its header says.
void requireWholeAvi(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  unsigned char head[12] = {};
  file.read(reinterpret_cast<char*>(head), sizeof head);
  if (std::string(head, head + 4) != "RIFF" || std::string(head + 8, head + 12) != "AVI ") return;
  const std::uint64_t length = head[4] | head[5] << 8 | head[6] << 16 | std::uint64_t{head[7]} << 24;
  if (fs::file_size(path) < length + 8) fail(path, "video is cut short: copy it again");
}

// The methods of cv::VideoCapture are virtual, so that the programs need OpenCV's library for videos only
// when there is one.
std::unique_ptr<cv::VideoCapture> videoCapture(const std::string& path) {
  void* library = dlopen("liball_in_focus_video.so", RTLD_NOW);
  void* symbol = library == nullptr ? nullptr : dlsym(library, "allInFocusVideoCapture");
  if (symbol == nullptr) fail(path, std::string("videos cannot be read: ") + dlerror());
  return std::unique_ptr<cv::VideoCapture>(reinterpret_cast<cv::VideoCapture* (*)()>(symbol)());
}

// OpenCV 4.5.5 to 4.6 turn videos the wrong way: we do it.
void keepAsStored(cv::VideoCapture& video) {
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 405
  video.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
#endif
}

// What the container says. Before 4.5 OpenCV does not tell it.
Orientation orientationOf(const cv::VideoCapture& video) {
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 405
  constexpr int kVersion = CV_VERSION_MAJOR * 10000 + CV_VERSION_MINOR * 100 + CV_VERSION_REVISION;
  constexpr bool kCounterclockwise = kVersion >= 40505 && kVersion < 40700;
  const int told = cvRound(video.get(cv::CAP_PROP_ORIENTATION_META));
  switch (kCounterclockwise ? (360 - told) % 360 : told) {  // degrees, clockwise
    case 90:
      return 6;
    case 180:
      return 3;
    case 270:
      return 8;
    default:
      break;
  }
#endif
  return 1;
}

}  // namespace

StackReader::StackReader(const std::string& path, const std::vector<cv::Size>& calibrated,
                         const std::set<std::string>& only)
    : path_(path) {
  if (holdsPictures(path)) {
    files_ = listStack(path, only);
    decideOrientation(readPhotoMetadata(this->path(0)).size, calibrated);
    findWhite();
    images_ =
        std::make_unique<ReadAhead>(static_cast<int>(names().size()), [this](int i) { return read(i); });
    return;
  }
  if (!fs::exists(path)) fail(path, "no such folder or video");
  if (!fs::is_regular_file(path)) fail(path, "is no regular file: copy what it gives into a file");
  // OpenCV would open it as a video, together with the images numbered after it.
  if (isPictureName(path)) fail(path, "a single image: give its folder, or a video");
  requireWholeAvi(path);
  video_ = videoCapture(path);
  open();
  files_.orientation = orientationOf(*video_);
  decideOrientation({static_cast<int>(video_->get(cv::CAP_PROP_FRAME_WIDTH)),
                     static_cast<int>(video_->get(cv::CAP_PROP_FRAME_HEIGHT))},
                    calibrated);
}

// Here, because only this file is compiled without the sanitizer "vptr".
StackReader::~StackReader() = default;

void StackReader::decideOrientation(const cv::Size& stored, const std::vector<cv::Size>& calibrated) {
  if (files_.orientation == 1) return;
  const cv::Size shown = uprightSize(stored, files_.orientation);
  const auto fits = [&calibrated](const cv::Size& size) {
    return std::find(calibrated.begin(), calibrated.end(), size) != calibrated.end();
  };
  turned_ = !fits(stored) && (calibrated.empty() || fits(shown));
  if (calibrated.empty()) return;
  files_.notes.push_back(path_ + ": the file says that its pictures are to be turned; " +
                         (turned_
                              ? "they are, as the calibration has them"
                              : "they are used as they are stored, as the calibration has them; the result "
                                "says how to turn it"));
}

cv::Mat StackReader::turned(const cv::Mat& image) const {
  return turned_ ? upright(image, files_.orientation) : image;
}

std::string StackReader::path(int i) const {
  return names().empty() ? path_ : source(i).path;
}

const StackFiles::Source& StackReader::source(int i) const {
  return files_.sources[static_cast<std::size_t>(i)];
}

cv::Mat StackReader::read(int i) const {
  const cv::Mat picture = readPicture(path(i), source(i).page);
  const auto white = white_.find(picture.depth());
  const bool is_raw = rawEndings().count(ending(path(i))) != 0;
  const double full = whiteCode(picture.depth(), picture.depth() == CV_16U ? 65535 : 1);
  return turned(toFrame(picture, white == white_.end() || is_raw ? full : white->second));
}

// Finds out what is white in frames of more than 8 bits: all must be scaled alike. The first, the middle and
// the last one tell where they use the whole range, else all are looked at.
void StackReader::findWhite() {
  std::vector<int> open;
  bool is_open = false;
  for (int i = 0; i < static_cast<int>(names().size()); ++i) {
    if (i == 0 || path(i) != path(i - 1)) is_open = hasOpenRange(path(i));
    if (is_open) open.push_back(i);
  }
  if (open.empty()) return;
  std::map<int, double> highest;  // by depth
  const auto look = [&](int i) {
    try {
      const cv::Mat picture = readPicture(path(i), source(i).page);
      highest[picture.depth()] =
          std::max(highest[picture.depth()], highestCode(path(i), source(i).page, picture));
    } catch (const std::invalid_argument&) {
      // Told when the frame is read in its turn.
    }
  };
  for (const int i : std::set<int>{open.front(), open[open.size() / 2], open.back()}) look(i);
  const bool is_one = highest.size() == 1;
  if (is_one && highest.count(CV_8U) > 0) return;
  if (is_one && highest.count(CV_16U) > 0 && whiteCode(CV_16U, highest[CV_16U]) == 65535) return;
  for (const int i : open) look(i);
  for (const auto& [depth, code] : highest) {
    if (depth == CV_8U) continue;
    try {
      white_[depth] = whiteCode(depth, code);
    } catch (const std::invalid_argument& e) {
      fail(path_, e.what());
    }
    if (white_[depth] == 65535) continue;
    files_.notes.push_back(path_ +
                           cv::format(": the highest code of the %s frames is %g: scaled so that %g is white",
                                      depth == CV_16U ? "16-bit" : "float", code, white_[depth]));
  }
}

std::string StackReader::frameName(int i) const {
  const std::string number = "frame " + std::to_string(i);
  return i < static_cast<int>(names().size()) ? number + " (" + names()[static_cast<std::size_t>(i)] + ")"
                                              : number;
}

void StackReader::open() {
  try {
    video_->open(path_, cv::CAP_FFMPEG);
  } catch (const cv::Exception&) {
  }
  if (!video_->isOpened()) fail(path_, "not a video that can be read");
  keepAsStored(*video_);
}

bool StackReader::next(cv::Mat& frame) {
  if (!names().empty()) {
    if (read_ == static_cast<int>(names().size())) {
      frame.release();  // what follows may need the memory
      return false;
    }
    images_->get(read_++, frame);
    return true;
  }
  if (video_->read(frame) && !frame.empty()) {
    ++read_;
    frame = turned(frame);
    return true;
  }
  requireWhole();
  return false;
}

void StackReader::rewind() {
  read_ = 0;
  if (names().empty()) open();
}

int StackReader::count() {
  if (!names().empty()) return static_cast<int>(names().size());
  if (count_ < 0) {
    rewind();
    while (video_->grab()) ++read_;
    requireWhole();
    count_ = read_;
    rewind();
  }
  return count_;
}

// Frames whose white is known from all of them.
cv::Mat StackReader::glanceAt(int i) const {
  if (white_.empty()) return turned(readHalfColor(path(i), source(i).page));
  return toColor(read(i));
}

cv::Mat StackReader::glance() {
  cv::Mat frame;
  try {
    if (!names().empty()) return glanceAt(static_cast<int>(names().size() / 2));
    const int middle = count() / 2;
    for (int i = 0; i < middle; ++i) video_->grab();
    if (video_->read(frame)) frame = turned(frame);
    rewind();
  } catch (const std::invalid_argument&) {
    // The error is reported when the frame is read in its turn.
  }
  return frame;
}

void StackReader::requireWhole() const {
  if (read_ == 0) fail(path_, "the video holds no frame");
  // Containers often report one frame too many.
  const double reported = video_->get(cv::CAP_PROP_FRAME_COUNT);
  if (reported - read_ > std::max(1.0, 0.01 * reported)) {
    fail(path_, "video is cut short: " + std::to_string(read_) + " of " +
                    std::to_string(static_cast<int>(reported)) + " frames can be read");
  }
}

std::string StackReader::current() const {
  return read_ == 0 ? path_ : path(read_ - 1);
}

}  // namespace all_in_focus
