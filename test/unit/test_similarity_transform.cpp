// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <stdexcept>

#include "alignment/reference_warp.hpp"
#include "bracket_drawing.hpp"

using namespace all_in_focus::core;
using bracket_drawing::kCenter;
using bracket_drawing::kSize;

namespace {

cv::Mat color(const cv::Mat& gray) {
  cv::Mat bgr;
  cv::merge(std::vector<cv::Mat>{gray, 255 - gray, gray / 2}, bgr);
  return bgr;
}

TEST(SimilarityTransform, ComposesAndInverts) {
  const SimilarityTransform a{1.02, {3, -4}, 0.1}, b{0.97, {-1, 0.5}, -0.3},
      there_and_back = compose(compose(a, b), inverse(compose(a, b)));
  EXPECT_NEAR(there_and_back.scale, 1, 1e-12);
  EXPECT_NEAR(there_and_back.angle, 0, 1e-12);
  EXPECT_NEAR(cv::norm(there_and_back.shift), 0, 1e-12);
  const cv::Point2d p(7, 5), c(2, 1);
  EXPECT_NEAR(cv::norm(compose(a, b).apply(p, c) - b.apply(a.apply(p, c), c)), 0, 1e-12);
}

TEST(SimilarityTransform, MovesTheFarthestCornerMost) {
  EXPECT_EQ(largestDisplacement({}, {11, 11}, {5, 5}), 0);
  EXPECT_DOUBLE_EQ(largestDisplacement({1, {3, 4}}, {11, 11}, {5, 5}), 5);
  EXPECT_NEAR(largestDisplacement({1.01, {0, 0}}, {101, 101}, {100, 100}), std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(largestDisplacement({1, {}, 0.01}, {101, 101}, {0, 0}), std::sqrt(2.0), 1e-4);
}

TEST(WarpToReference, NoMotionCopies) {
  const cv::Mat image = color(bracket_drawing::frame({}));
  const cv::Mat out = warpedToReference(image, {}, kCenter);
  EXPECT_EQ(cv::norm(image, out, cv::NORM_INF), 0);
  EXPECT_NE(image.data, out.data);
}

TEST(WarpToReference, WholePixelsAreExactAndTheBorderGoesOn) {
  const cv::Mat image = color(bracket_drawing::frame({}));
  const cv::Mat out = warpedToReference(image, {1, {5, -3}}, kCenter);
  const cv::Rect inside(0, 3, kSize.width - 5, kSize.height - 3);
  EXPECT_EQ(cv::norm(out(inside), image(inside + cv::Point(5, -3)), cv::NORM_INF), 0);
  EXPECT_EQ(out.at<cv::Vec3b>(0, kSize.width - 1), image.at<cv::Vec3b>(0, kSize.width - 1));
}

// 50 dB are 0.8 gray levels, root mean square; the roundings of frame and result alone make 0.4.
TEST(WarpToReference, BringsAFrameBack) {
  for (const SimilarityTransform& motion :
       {SimilarityTransform{1.03, {2.4, -1.7}}, SimilarityTransform{0.98, {-0.3, 0.5}},
        SimilarityTransform{1, {0.5, 0.5}}}) {
    const cv::Mat out = warpedToReference(color(bracket_drawing::frame(motion)), motion, kCenter);
    const cv::Rect inside(12, 12, kSize.width - 24, kSize.height - 24);
    EXPECT_GT(cv::PSNR(out(inside), color(bracket_drawing::frame({}))(inside)), 50) << motion.scale;  // 53
  }
}

TEST(WarpToReference, BringsARolledFrameBack) {
  for (const SimilarityTransform& motion :
       {SimilarityTransform{1, {}, 0.01}, SimilarityTransform{1.02, {1.4, -2.7}, -0.03},
        SimilarityTransform{0.99, {0.5, 0.25}, 0.002}}) {
    const cv::Mat out = warpedToReference(color(bracket_drawing::frame(motion)), motion, kCenter);
    const cv::Rect inside(16, 16, kSize.width - 32, kSize.height - 32);
    EXPECT_GT(cv::PSNR(out(inside), color(bracket_drawing::frame({}))(inside)), 50) << motion.angle;  // 53
  }
}

TEST(WarpToReference, SmallPicturesAndFarMotions) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 7), cv::Size(9, 3)}) {
    const cv::Mat plain(size, CV_8UC3, cv::Scalar(7, 80, 255));
    for (const SimilarityTransform& motion :
         {SimilarityTransform{1.05, {0.4, 0.2}}, SimilarityTransform{0.1, {900, -900}},
          SimilarityTransform{9, {-900, 0}}, SimilarityTransform{1, {1, 2}, 0.5}}) {
      const cv::Mat out = warpedToReference(plain, motion, {1, 1});
      EXPECT_EQ(cv::norm(plain, out, cv::NORM_INF), 0);
    }
  }
}

TEST(WarpToReference, FlatPicturesKeepTheirLevel) {
  for (int level = 0; level < 256; ++level) {
    const cv::Mat plain(24, 40, CV_8UC3, cv::Scalar(level, 255 - level, 128));
    for (const double angle : {0.0, 0.03}) {
      const cv::Mat out = warpedToReference(plain, {1.037, {0.43, -0.21}, angle}, {20, 12});
      EXPECT_EQ(cv::norm(plain, out, cv::NORM_INF), 0) << level << ", " << angle;
    }
  }
}

// The sum over all taps of one channel, in double precision.
double lanczosAt(const cv::Mat& image, double x, double y, int channel) {
  const auto kernel = [](double d) {
    if (std::abs(d) < 1e-9) return 1.0;
    return std::abs(d) < 3 ? 3 * std::sin(CV_PI * d) * std::sin(CV_PI * d / 3) / (CV_PI * CV_PI * d * d)
                           : 0.0;
  };
  double sum = 0, weights = 0;
  for (int v = static_cast<int>(std::floor(y)) - 2; v <= std::floor(y) + 3; ++v) {
    for (int u = static_cast<int>(std::floor(x)) - 2; u <= std::floor(x) + 3; ++u) {
      const double weight = kernel(x - u) * kernel(y - v);
      sum += weight * image.at<cv::Vec3b>(v, u)[channel];
      weights += weight;
    }
  }
  return sum / weights;
}

TEST(WarpToReference, IsALanczosKernelAlsoAtTheGreatestContrast) {
  cv::Mat image(48, 64, CV_8UC3);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 2);
  image *= 255;
  const SimilarityTransform motion{1.03, {0.4, -0.7}};
  const cv::Point2d center(31.5, 23.5);
  const cv::Mat out = warpedToReference(image, motion, center);
  int different = 0, all = 0;
  for (int y = 8; y < 40; ++y) {
    for (int x = 8; x < 56; ++x) {
      const cv::Point2d from = motion.apply(cv::Point2d(x, y), center);
      for (int c = 0; c < 3; ++c, ++all) {
        const int expected = cv::saturate_cast<std::uint8_t>(lanczosAt(image, from.x, from.y, c));
        const int difference = std::abs(out.at<cv::Vec3b>(y, x)[c] - expected);
        EXPECT_LE(difference, 1);
        different += difference;
      }
    }
  }
  EXPECT_LT(different, all / 20);  // rounded the other way: 1 of 35
}

TEST(SimilarityTransform, AFrameShowsARectangleOfTheReference) {
  const cv::Size size(640, 480);
  const cv::Point2d center(319.5, 239.5);
  SimilarityTransform motion;
  EXPECT_EQ(seenThrough(motion, size, center), cv::Rect({}, size));
  motion.shift = {10, -20};  // to the frame: the reference shows more to the left and at the bottom
  EXPECT_EQ(seenThrough(motion, size, center), cv::Rect(0, 20, 630, 460));
}

TEST(SimilarityTransform, AFrameThatLiesOutsideShowsNothingOfTheReference) {
  const cv::Size size(640, 480);
  const cv::Point2d center(319.5, 239.5);
  for (const cv::Point2d& shift : {cv::Point2d(700, 0), {-700, 0}, {0, 500}, {0, -500}, {-700, 500}}) {
    EXPECT_EQ(seenThrough({1, shift}, size, center).area(), 0) << shift;
  }
  const SimilarityTransform rolled{1, {}, 1};  // its corners cross: no upright rectangle fits
  EXPECT_EQ(seenThrough(rolled, size, center).area(), 0);
}

}  // namespace
