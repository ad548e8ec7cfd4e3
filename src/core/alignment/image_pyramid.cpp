// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/image_pyramid.hpp"

#include <algorithm>
#include <cstddef>
#include <opencv2/imgproc.hpp>

#include "alignment/alignment_parameters.hpp"

namespace all_in_focus::core {

void ImagePyramid::build(const cv::Mat& gray) {
  cv::pyrDown(gray, halved_);
  finest_reduction_ = 2;
  while (halved_.total() > kAlignment.largest_level) {
    cv::pyrDown(halved_, halved_again_);
    cv::swap(halved_, halved_again_);
    finest_reduction_ *= 2;
  }
  const int side = std::min(halved_.cols, halved_.rows);
  std::size_t levels = 1;
  while (side >> levels >= kAlignment.smallest_side) ++levels;
  images_.resize(levels);
  halved_.convertTo(images_[0], CV_32F);
  for (std::size_t i = 0; i < levels; ++i) {
    if (i > 0) cv::pyrDown(images_[i - 1], images_[i]);
    cv::GaussianBlur(images_[i], images_[i], cv::Size(3, 3), 0);
  }
  cv::GaussianBlur(images_.back(), contrast_, cv::Size(), kAlignment.contrast_sigma);
  cv::subtract(images_.back(), contrast_, contrast_);
}

ImagePyramid ImagePyramid::clone() const {
  ImagePyramid copy;
  for (const cv::Mat& image : images_) copy.images_.push_back(image.clone());
  copy.contrast_ = contrast_.clone();
  copy.finest_reduction_ = finest_reduction_;
  return copy;
}

}  // namespace all_in_focus::core
