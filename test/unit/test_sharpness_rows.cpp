// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "fusion/sharpness_rows.hpp"

using namespace all_in_focus::core;

namespace {

constexpr double kRounding = 2e-3;  // of numbers up to 1020

cv::Mat randomGray(const cv::Size& size) {
  cv::Mat gray(size, CV_8UC1);
  cv::RNG(size.area()).fill(gray, cv::RNG::UNIFORM, 0, 256);
  return gray;
}

// As OpenCV computes it, image by image.
struct Whole {
  explicit Whole(const cv::Mat& gray) {
    cv::Mat along, across;
    const cv::Mat kernel = (cv::Mat_<float>(1, 3) << -1, 2, -1);
    cv::filter2D(gray, along, CV_32F, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
    cv::filter2D(gray, across, CV_32F, kernel.t(), {-1, -1}, 0, cv::BORDER_REPLICATE);
    cv::GaussianBlur(cv::abs(along) + cv::abs(across), small, {}, 1.2);
    const cv::Size quarter(std::max(1, gray.cols / 4), std::max(1, gray.rows / 4));
    cv::resize(small, reduced, quarter, 0, 0, cv::INTER_AREA);
    cv::Mat smoothed;
    cv::GaussianBlur(reduced, smoothed, {}, 5 / 4.0);
    cv::resize(smoothed, around, gray.size(), 0, 0, cv::INTER_LINEAR);
  }
  cv::Mat small, reduced, around;
};

cv::Mat row(const float* values, int n) {
  return cv::Mat(1, n, CV_32FC1, const_cast<float*>(values));
}

const cv::Size kSizes[] = {{1, 1},  {1, 9},   {9, 1},    {3, 2},    {4, 4},    {5, 7},     {7, 5},
                           {11, 6}, {64, 48}, {101, 67}, {741, 50}, {43, 242}, {1100, 45}, {640, 480}};

TEST(SharpnessRows, AreThoseOfTheWholeImages) {
  SharpnessRows rows;
  for (const cv::Size& size : kSizes) {
    const cv::Mat gray = randomGray(size);
    const Whole whole(gray);
    rows.begin(gray);
    for (int y = 0; y < size.height; ++y) {
      ASSERT_LE(cv::norm(row(rows.around(y), size.width), whole.around.row(y), cv::NORM_INF), kRounding)
          << size << y;
      ASSERT_LE(cv::norm(row(rows.small(y), size.width), whole.small.row(y), cv::NORM_INF), kRounding)
          << size << y;
    }
    rows.begin(gray);
    ASSERT_EQ(rows.reducedSize(), whole.reduced.size());
    std::vector<float> reduced(whole.reduced.cols);
    for (int y = 0; y < whole.reduced.rows; ++y) {
      rows.reduced(y, reduced.data());
      ASSERT_LE(cv::norm(row(reduced.data(), whole.reduced.cols), whole.reduced.row(y), cv::NORM_INF),
                kRounding)
          << size << y;
    }
  }
}

TEST(SharpnessRows, AreTheSameWhereverOneBegins) {
  const cv::Mat gray = randomGray({70, 90});
  SharpnessRows all, some;
  all.begin(gray);
  cv::Mat around(gray.size(), CV_32FC1), small(gray.size(), CV_32FC1);
  for (int y = 0; y < gray.rows; ++y) {
    row(all.around(y), gray.cols).copyTo(around.row(y));
    row(all.small(y), gray.cols).copyTo(small.row(y));
  }
  for (const int first : {1, 40, 89, 3}) {
    some.begin(gray);
    for (int y = first; y < gray.rows; y += 7) {
      EXPECT_EQ(cv::norm(row(some.around(y), gray.cols), around.row(y), cv::NORM_INF), 0);
      EXPECT_EQ(cv::norm(row(some.small(y), gray.cols), small.row(y), cv::NORM_INF), 0);
    }
  }
}

TEST(SharpnessRows, RefusesWhatIsNotGray) {
  SharpnessRows rows;
  EXPECT_THROW(rows.begin(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(rows.begin(cv::Mat(4, 4, CV_8UC3)), std::invalid_argument);
}

}  // namespace
