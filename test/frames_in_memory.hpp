// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "all_in_focus/pipeline.hpp"

namespace all_in_focus::core {

/// Frames that are in memory already.
class FramesInMemory : public FrameSource {
 public:
  explicit FramesInMemory(std::vector<cv::Mat> frames) : frames_(std::move(frames)) {}
  bool next(cv::Mat& frame) override {
    if (next_ == frames_.size()) return false;
    frame = frames_[next_++];
    return true;
  }
  void rewind() override { next_ = 0; }
  int count() override { return static_cast<int>(frames_.size()); }

 private:
  std::vector<cv::Mat> frames_;
  std::size_t next_ = 0;
};

}  // namespace all_in_focus::core
