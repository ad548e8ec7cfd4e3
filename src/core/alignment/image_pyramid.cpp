// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/image_pyramid.hpp"

#include <algorithm>
#include <cstddef>
#include <opencv2/imgproc.hpp>

#include "alignment/alignment_parameters.hpp"

namespace all_in_focus::core {

ImagePyramid::ImagePyramid(const cv::Mat& gray) {
  cv::Mat halved;
  cv::pyrDown(gray, halved);
  for (; halved.total() > kAlignment.largest_level; finest_reduction_ *= 2) cv::pyrDown(halved, halved);
  const int side = std::min(halved.cols, halved.rows);
  std::size_t levels = 1;
  while (side >> levels >= kAlignment.smallest_side) ++levels;
  images_.resize(levels);
  halved.convertTo(images_[0], CV_32F);
  for (std::size_t i = 0; i < levels; ++i) {
    if (i > 0) cv::pyrDown(images_[i - 1], images_[i]);
    cv::GaussianBlur(images_[i], images_[i], cv::Size(3, 3), 0);
  }
  cv::GaussianBlur(images_.back(), contrast_, cv::Size(), kAlignment.contrast_sigma);
  cv::subtract(images_.back(), contrast_, contrast_);
}

}  // namespace all_in_focus::core
