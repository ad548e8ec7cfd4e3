// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "all_in_focus/pipeline.hpp"
#include "read_ahead.hpp"
#include "stack_files.hpp"

namespace all_in_focus {

/// The frames of a focus bracket, one after the other: the pictures of a folder, see listStack(), the pages
/// of a TIFF, or a video. Images are decoded ahead, on threads of their own. Videos are decoded in sequence:
/// seeking lands on other frames, and the reported count is a guess.
class StackReader : public core::FrameSource {
 public:
  /// calibrated: sizes of the pictures that a calibration or a depth map belongs to, if there are some.
  /// Frames are turned as their EXIF data say, but not where they fit a calibrated size as they are stored.
  /// only: names of the folder's pictures to read; empty: all. Throws std::invalid_argument when there is
  /// nothing to read.
  explicit StackReader(const std::string& path, const std::vector<cv::Size>& calibrated = {},
                       const std::set<std::string>& only = {});
  ~StackReader() override;

  /// CV_8U or CV_16U; three channels, or four where pixels are transparent. False at the end. Throws
  /// std::invalid_argument on a broken image or a video that is cut short.
  bool next(cv::Mat& frame) override;

  /// Back to the first frame. A video is opened anew.
  void rewind() override;

  /// A video is decoded to its end, once, and rewound.
  int count() override;

  /// A frame from the middle of the bracket, CV_8UC3, at half its width and height or more; empty where it
  /// cannot be read. Goes back to the first frame.
  cv::Mat glance();

  /// The file that the last frame came from.
  std::string current() const;

  /// File names of a folder's frames, in order; empty for a video.
  const std::vector<std::string>& names() const { return files_.frames; }
  /// Names of pictures in the folder that are no frames.
  const std::vector<std::string>& leftOut() const { return files_.left_out; }
  /// Path of frame i; of a video, its own.
  std::string path(int i) const;
  /// What messages call frame i: "frame 7 (IMG_0008.JPG)".
  std::string frameName(int i) const;
  /// How the frames, as they are read, are still to be turned before they are shown.
  Orientation orientation() const { return turned_ ? 1 : files_.orientation; }
  /// Lines for the user about the files of the folder.
  const std::vector<std::string>& notes() const { return files_.notes; }

 private:
  const StackFiles::Source& source(int i) const;
  void findWhite();
  cv::Mat read(int i) const;
  cv::Mat glanceAt(int i) const;
  void decideOrientation(const cv::Size& stored, const std::vector<cv::Size>& calibrated);
  cv::Mat turned(const cv::Mat& image) const;
  void open();
  void requireWhole() const;

  std::string path_;
  StackFiles files_;
  std::map<int, double> white_;        // code of white by depth, where it is not the highest that fits
  bool turned_ = false;                // the frames are turned when they are read
  std::unique_ptr<ReadAhead> images_;  // of the folder's frames
  std::unique_ptr<cv::VideoCapture> video_;
  int read_ = 0;
  int count_ = -1;  // of a video, -1 = not yet counted
};

}  // namespace all_in_focus
