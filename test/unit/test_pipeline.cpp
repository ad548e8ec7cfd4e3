// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <stdexcept>

#include "frames_in_memory.hpp"

using namespace all_in_focus::core;

namespace {

FramesInMemory equalFrames(int count) {
  return FramesInMemory(std::vector<cv::Mat>(count, cv::Mat(40, 48, CV_8UC3, cv::Scalar::all(100))));
}

TEST(Pipeline, ReferencesThatAreNoFramesAreRefused) {
  for (const Mode mode : {Mode::kPaper, Mode::kRefined, Mode::kRestored}) {
    for (const int reference : {-16, -2, 3, 1000}) {
      FramesInMemory frames = equalFrames(3);
      PipelineInput input;
      input.frames = &frames;
      input.reference = reference;
      EXPECT_THROW(Pipeline(mode).run(input), std::invalid_argument) << name(mode) << ' ' << reference;
    }
  }
}

// Gives the last frame away at its end, as a reader of files does to save memory.
class ReleasingFrames : public FramesInMemory {
 public:
  using FramesInMemory::FramesInMemory;
  bool next(cv::Mat& frame) override {
    const bool is_there = FramesInMemory::next(frame);
    if (!is_there) frame.release();
    return is_there;
  }
};

TEST(Pipeline, TheLastFrameCanBeAskedForAgain) {
  cv::Mat noise(40, 48, CV_8UC3);
  cv::randu(noise, 0, 255);
  ReleasingFrames frames({noise, cv::Mat::zeros(noise.size(), CV_8UC3)});
  PipelineInput input;
  input.frames = &frames;
  const PipelineResult result = Pipeline(Mode::kRefined).run(input);
  EXPECT_EQ(result.bracket.used, 1);
  EXPECT_EQ(result.bracket.reference, 0);
}

}  // namespace
