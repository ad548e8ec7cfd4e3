// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/image_pyramid.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr int kLargestLevel = 1 << 20;  // pixels
constexpr int kSmallestSide = 24;       // pixels; a smaller picture says little
constexpr double kContrastSigma = 3;    // px of the coarsest level

}  // namespace

void ImagePyramid::build(const cv::Mat& gray) {
  cv::pyrDown(gray, halved_);
  finest_reduction_ = 2;
  while (halved_.total() > kLargestLevel) {
    cv::pyrDown(halved_, halved_again_);
    cv::swap(halved_, halved_again_);
    finest_reduction_ *= 2;
  }
  const int side = std::min(halved_.cols, halved_.rows);
  for (levels_ = 1; side >> levels_ >= kSmallestSide;) ++levels_;
  if (static_cast<int>(images_.size()) < levels_) images_.resize(levels_);
  halved_.convertTo(images_[0], CV_32F);
  for (int i = 0; i < levels_; ++i) {
    if (i > 0) cv::pyrDown(images_[i - 1], images_[i]);
    cv::GaussianBlur(images_[i], images_[i], cv::Size(3, 3), 0);
  }
  cv::GaussianBlur(images_[levels_ - 1], contrast_, cv::Size(), kContrastSigma);
  cv::subtract(images_[levels_ - 1], contrast_, contrast_);
}

ImagePyramid ImagePyramid::clone() const {
  ImagePyramid copy;
  for (int i = 0; i < levels_; ++i) copy.images_.push_back(images_[i].clone());
  copy.contrast_ = contrast_.clone();
  copy.levels_ = levels_;
  copy.finest_reduction_ = finest_reduction_;
  return copy;
}

}  // namespace all_in_focus::core
