// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// What the first images of a process cost, until memory, threads and code are there: everything with two
// frames (mode paper) for one depth image again and again, in ms.
//
//   first_images RIG_FOLDER DEPTH.png

#include <chrono>
#include <cstdio>
#include <exception>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/pipeline.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"

namespace {

using namespace all_in_focus;

constexpr int kImages = 8;

class TwoFrames : public core::FrameSource {
 public:
  explicit TwoFrames(const cv::Size& size) {
    cv::RNG random(1);
    for (cv::Mat& frame : frames_) {
      frame.create(size, CV_8UC3);
      random.fill(frame, cv::RNG::UNIFORM, 0, 255);
    }
  }
  bool next(cv::Mat& frame) override {
    if (given_ == count()) return false;
    frame = frames_[given_++];
    return true;
  }
  void rewind() override { given_ = 0; }
  int count() override { return 2; }

 private:
  cv::Mat frames_[2];
  int given_ = 0;
};

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 3) {
    std::fprintf(stderr, "usage: first_images RIG_FOLDER DEPTH.png\n");
    return 2;
  }
  core::PipelineInput input;
  input.rig = readRig(argv[1]);
  input.has_rig = true;
  input.depth = readDepth(argv[2]);
  input.optics = readOptics(argv[1]);
  input.focus_mm = {1000, 3000};
  TwoFrames frames(input.rig.color.size);
  input.frames = &frames;
  core::Pipeline pipeline(core::Mode::kPaper);
  for (int i = 0; i < kImages; ++i) {
    frames.rewind();
    const auto begin = std::chrono::steady_clock::now();
    pipeline.run(input);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - begin;
    std::printf("%.1f%c", time.count(), i + 1 < kImages ? ' ' : '\n');
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "first_images: %s\n", error.what());
  return 2;
}
