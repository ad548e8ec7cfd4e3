// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "../test/frames_in_memory.hpp"

namespace all_in_focus {

using namespace core;

/// Depth map, rig and lens that a benchmark runs on.
struct Sample {
  Rig rig;
  cv::Mat depth;  ///< CV_16UC1 mm, of the rig's depth camera
  Optics optics;  ///< 24 mm, F 4, circle of confusion 0.019 mm
};

/// How a generated scene was measured.
enum class Sensor {
  kKinect,  ///< disparity in steps of 1/8 pixel: long runs of equal depth
  kNoisy,   ///< 3 mm of noise on every pixel, as stereo cameras have it: no two neighbours are equal
};

/// Makes samples of any size once and keeps them. Both cameras of a generated rig have that size.
class Samples {
 public:
  /// A recorded sample is taken instead of generated ones where its colour camera has the size asked for.
  static void setRecorded(const Sample& recorded);

  static const Sample& get(const cv::Size& size, Sensor sensor);

  /// Depth seen from the colour camera, holes filled.
  static cv::Mat filled(const Sample& sample, Mode mode);

  /// Depth with 3 mm of noise on every known pixel, another one for each seed.
  static cv::Mat withNoise(const cv::Mat& depth, int seed);

  /// What a bracket's fusion starts from; labels as mode paper cuts them.
  static const BracketScene& scene(const Sample& sample);

  /// Frames of a focus sweep: each is sharp in one band and a little larger than the one before.
  static const std::vector<cv::Mat>& sweep(const cv::Size& size);

  /// For everything with two frames, which must outlive the input.
  static PipelineInput input(const Sample& sample, FramesInMemory& frames);
};

}  // namespace all_in_focus
