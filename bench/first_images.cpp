// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// What the first images of a process cost, until memory, threads and code are there: everything with two
// frames in mode paper, for one depth image again and again. A line for each: ms, and how many pages of
// memory the process touched for the first time.
//
//   first_images RIG_FOLDER DEPTH.png

#include <sys/resource.h>

#include <chrono>
#include <exception>
#include <iostream>
#include <opencv2/core.hpp>

#include "bench_scene.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"

namespace {

using namespace all_in_focus;

constexpr int kImages = 8;

cv::Mat noise(const cv::Size& size) {  // made without the code that is timed
  cv::Mat frame(size, CV_8UC3);
  cv::RNG(1).fill(frame, cv::RNG::UNIFORM, 0, 255);
  return frame;
}

long pagesTouched() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_minflt;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "first_images: give RIG_FOLDER and DEPTH.png\n";
    return 2;
  }
  try {
    const Sample sample{readRig(argv[1]), readDepth(argv[2]), readOptics(argv[1])};
    FramesInMemory frames({noise(sample.rig.color.size), noise(sample.rig.color.size)});
    const PipelineInput input = Samples::input(sample, frames);
    Pipeline pipeline(Mode::kPaper);
    for (int i = 0; i < kImages; ++i) {
      frames.rewind();
      const long pages = pagesTouched();
      const auto begin = std::chrono::steady_clock::now();
      pipeline.run(input);
      const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - begin;
      std::cout << cv::format("%6.1f ms %6ld pages\n", time.count(), pagesTouched() - pages);
    }
  } catch (const std::exception& error) {
    std::cerr << "first_images: " << error.what() << '\n';
    return 2;
  }
  return 0;
}
