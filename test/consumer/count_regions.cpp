// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Cuts a depth map by the library and tells of it in a message of the package.

#include <all_in_focus/SegmentArray.h>

#include <all_in_focus/dof_segmentation.hpp>
#include <all_in_focus/pipeline.hpp>
#include <iostream>

int main() {
  cv::Mat depth(48, 64, CV_16UC1, cv::Scalar(1000));
  depth.colRange(32, 64).setTo(3000);
  all_in_focus::core::Segmentation result;
  all_in_focus::core::DofSegmentation().compute(depth, result);
  all_in_focus::SegmentArray message;
  message.segments.resize(result.segments.size());
  std::cout << message.segments.size() << " regions\n";
}
