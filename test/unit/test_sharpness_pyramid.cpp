// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "fusion/sharpness_pyramid.hpp"

using namespace all_in_focus::core;

namespace {

cv::Mat randomGray(const cv::Size& size) {
  cv::Mat gray(size, CV_8UC1);
  cv::RNG(size.area()).fill(gray, cv::RNG::UNIFORM, 0, 256);
  return gray;
}

cv::Mat smoothedLaplacian(const cv::Mat& image, double sigma, int side) {
  cv::Mat along, across, smoothed;
  const cv::Mat kernel = (cv::Mat_<float>(1, 3) << -1, 2, -1);
  cv::filter2D(image, along, CV_32F, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
  cv::filter2D(image, across, CV_32F, kernel.t(), {-1, -1}, 0, cv::BORDER_REPLICATE);
  cv::GaussianBlur(cv::abs(along) + cv::abs(across), smoothed, {side, side}, sigma);
  return smoothed;
}

// Pixel i of the coarser level lies on pixel 2 i.
cv::Mat enlarged(const cv::Mat& coarser, const cv::Size& size) {
  cv::Mat out(size, CV_32FC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const auto at = [&](int v, int u) {
        return coarser.at<float>(std::min(v, coarser.rows - 1), std::min(u, coarser.cols - 1));
      };
      const int v = y / 2, u = x / 2, below = v + y % 2, right = u + x % 2;
      out.at<float>(y, x) = (at(v, u) + at(v, right) + at(below, u) + at(below, right)) / 4;
    }
  }
  return out;
}

// As the header says, image by image, in floats.
cv::Mat naiveProduct(const cv::Mat& gray, const SharpnessPyramid::Gauge& gauge) {
  std::vector<cv::Mat> levels(1);
  gray.convertTo(levels[0], CV_32F);
  while (gauge.scales && std::min(gray.cols, gray.rows) >> levels.size() >= 12) {
    cv::Mat coarser;
    cv::pyrDown(levels.back(), coarser);
    levels.push_back(coarser);
  }
  const int predicted_level = std::max(1, static_cast<int>(std::round(std::log2(gray.cols / 640.0))));
  cv::Mat product;
  for (int l = static_cast<int>(levels.size()) - 1; l >= 0; --l) {
    const double floor = std::pow(0.6, l) * (1.7 + 12 * gauge.noise.deviation());
    const double factor = l == 0 && gauge.resampled ? 0.85 : 1;
    cv::Mat sharpness =
        factor * (l == 0 ? smoothedLaplacian(levels[l], 0.85, 5) : smoothedLaplacian(levels[l], 1.45, 7));
    cv::sqrt(sharpness.mul(sharpness) + floor * floor, sharpness);
    product = product.empty() ? sharpness : sharpness.mul(enlarged(product, levels[l].size()));
    if (l == 0) break;
    cv::Mat root;
    cv::sqrt(product, root);
    if (l == 2) cv::pow(product, 0.75, product);
    if (gauge.predicted.empty() || l != predicted_level) continue;
    cv::Mat predicted;
    cv::resize(gauge.predicted, predicted, root.size(), 0, 0, cv::INTER_NEAREST);
    root.copyTo(product, predicted);
  }
  return product;
}

// Block by block: the first of them begins with row `first`, every `step` rows the next.
cv::Mat product(const cv::Mat& gray, const SharpnessPyramid::Gauge& gauge, int first = 0, int step = 64,
                int rows = 64) {
  SharpnessPyramid pyramid;
  pyramid.begin(gray, gauge);
  cv::Mat out(gray.size(), CV_32FC1, cv::Scalar(0));
  for (int y = first; y < gray.rows; y += step) {
    const cv::Range block(y, std::min(y + rows, gray.rows));
    pyramid.compute(block).copyTo(out.rowRange(block));
  }
  return out;
}

NoiseSpectrum whiteNoise(double deviation) {
  return NoiseSpectrum(std::vector<double>{3.909 * deviation});
}

double largestRatio(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a / b - 1, cv::NORM_INF);
}

const cv::Size kSizes[] = {{1, 1},   {1, 9},    {9, 1},    {3, 2},    {5, 7},    {25, 24},
                           {64, 48}, {101, 67}, {741, 50}, {43, 242}, {640, 480}};

TEST(SharpnessPyramid, IsTheProductOverAllLevels) {
  const NoiseSpectrum noise = whiteNoise(3);
  for (const cv::Size& size : kSizes) {
    cv::Mat gray = randomGray(size);
    for (const double blur : {0.0, 4.0}) {
      if (blur > 0) cv::GaussianBlur(gray, gray, {}, blur);
      for (const SharpnessPyramid::Gauge& gauge : {SharpnessPyramid::Gauge{{}, true},
                                                   {noise, true},
                                                   {noise, false},
                                                   {noise, true, false, {}, true}}) {
        EXPECT_LT(largestRatio(product(gray, gauge), naiveProduct(gray, gauge)), 0.01) << size << blur;
      }
    }
  }
}

TEST(SharpnessPyramid, IsTheSameWhereverOneBegins) {
  const cv::Mat gray = randomGray({70, 90}), all = product(gray, {});
  for (const int first : {1, 40, 89, 3}) {
    const cv::Mat some = product(gray, {}, first, 7, 1);
    for (int y = first; y < gray.rows; y += 7) {
      EXPECT_EQ(cv::norm(some.row(y), all.row(y), cv::NORM_INF), 0);
    }
  }
}

TEST(SharpnessPyramid, EnlargedNoiseChoosesLittle) {
  const auto spread = [](int factor) {
    cv::Mat noise(1920 / factor, 2560 / factor, CV_8UC1), frame;
    cv::RNG(7).fill(noise, cv::RNG::NORMAL, 128, 5);
    cv::resize(noise, frame, {2560, 1920}, 0, 0, cv::INTER_CUBIC);
    cv::Mat logarithm;
    cv::log(product(frame, {NoiseSpectrum::of(frame)}), logarithm);
    cv::Scalar mean, deviation;
    cv::meanStdDev(logarithm, mean, deviation);
    return deviation[0];
  };
  const double white = spread(1);
  for (const int factor : {2, 3, 5}) EXPECT_LT(spread(factor), 2.2 * white) << factor;  // 1.05
}

TEST(SharpnessPyramid, HoldsForHugeFramesOfTheGreatestContrast) {
  cv::Mat gray(6000, 6000, CV_8UC1);
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) gray.at<uchar>(y, x) = (x ^ y) & 1 ? 255 : 0;
  }
  EXPECT_TRUE(cv::checkRange(product(gray, {whiteNoise(50), true}, 0, 500), true, nullptr, 0, 1e38));
}

TEST(SharpnessPyramid, SeesFromAfarThatAFlatPlaceBelongsToASharpFrame) {
  // A bar on bare ground. Where its blur reaches the finest scale sees nothing in either frame.
  cv::Mat sharp(480, 640, CV_8UC1, cv::Scalar(100)), blurred;
  sharp(cv::Rect(200, 0, 60, 480)) = 200;
  cv::blur(sharp, blurred, {41, 41});
  const cv::Point flat(272, 240);
  const SharpnessPyramid::Gauge all, finest{{}, false};
  EXPECT_GT(product(sharp, all).at<float>(flat), 1.5f * product(blurred, all).at<float>(flat));
  EXPECT_NEAR(product(sharp, finest).at<float>(flat), product(blurred, finest).at<float>(flat), 1);
}

TEST(SharpnessPyramid, HardlyTrustsAFrameThatIsSharpNowhere) {
  cv::Mat sharp = randomGray({320, 240}), blurred;
  cv::GaussianBlur(sharp, blurred, {}, 20);
  const SharpnessPyramid::Gauge plain, trusting{{}, true, true};
  EXPECT_EQ(cv::norm(product(sharp, trusting), product(sharp, plain), cv::NORM_INF), 0);
  EXPECT_LT(cv::norm(product(blurred, trusting), cv::NORM_INF),
            0.1 * cv::norm(product(blurred, plain), cv::NORM_INF));
}

TEST(SharpnessPyramid, TrustsAnEnlargedFrameAsMuch) {
  cv::Mat sharp, enlarged;  // at its level 1 the enlarged one is sharp nowhere
  cv::GaussianBlur(randomGray({640, 480}), sharp, {}, 1.5);
  cv::resize(sharp, enlarged, {}, 4, 4, cv::INTER_CUBIC);
  const SharpnessPyramid::Gauge plain, trusting{{}, true, true};
  EXPECT_EQ(cv::norm(product(sharp, trusting), product(sharp, plain), cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(product(enlarged, trusting), product(enlarged, plain), cv::NORM_INF), 0);
}

TEST(SharpnessPyramid, AResampledFrameCountsLessWhereTheFinestLevelShowsDetail) {
  cv::Mat gray(200, 200, CV_8UC1, cv::Scalar(128));
  cv::Mat textured = gray.colRange(0, 100);
  cv::RNG(3).fill(textured, cv::RNG::UNIFORM, 0, 256);
  SharpnessPyramid::Gauge resampled;
  resampled.resampled = true;
  const cv::Mat share = product(gray, resampled) / product(gray, {});
  EXPECT_LT(largestRatio(share.colRange(0, 90), cv::Mat(200, 90, CV_32FC1, cv::Scalar(0.85))), 0.01);
  EXPECT_EQ(cv::norm(share.colRange(110, 200), cv::Mat(200, 90, CV_32FC1, cv::Scalar(1)), cv::NORM_INF), 0);
}

TEST(SharpnessPyramid, CoarserLevelsCountByTheirRootWhereDepthHasASay) {
  const cv::Mat gray = randomGray({200, 120});
  SharpnessPyramid::Gauge finest, predicted;
  finest.scales = false;
  predicted.predicted = cv::Mat(60, 100, CV_8UC1, cv::Scalar(0));
  predicted.predicted.colRange(0, 50) = 255;
  const cv::Mat all = product(gray, {}), of_finest = product(gray, finest), some = product(gray, predicted);
  const cv::Rect known(0, 0, 98, 120), unknown(102, 0, 98, 120);
  EXPECT_EQ(cv::norm(some(unknown), all(unknown), cv::NORM_INF), 0);
  cv::Mat root;
  cv::sqrt(all / of_finest, root);
  EXPECT_LT(largestRatio(some(known), root.mul(of_finest)(known)), 0.05);
}

TEST(SharpnessPyramid, TheRootIsTakenWhereWindowsReachFartherThanEdgesAreUncertain) {
  for (const cv::Size& size : {cv::Size(200, 120), {1200, 60}, {1900, 60}, {3700, 200}}) {
    const cv::Mat gray = randomGray(size);
    SharpnessPyramid::Gauge gauge;
    gauge.predicted = cv::Mat(size / 4, CV_8UC1, cv::Scalar(0));
    gauge.predicted.colRange(0, size.width / 8) = 255;
    EXPECT_LT(largestRatio(product(gray, gauge), naiveProduct(gray, gauge)), 0.01) << size;
  }
}

TEST(SharpnessPyramid, NearLightsCoarserLevelsShowLittle) {
  // Of two white discs the larger one, with a softer rim, is the more blurred light.
  cv::Mat sharp(240, 320, CV_8UC1, cv::Scalar(80)), blurred = sharp.clone();
  cv::circle(sharp, {160, 120}, 2, 255, cv::FILLED);
  cv::circle(blurred, {160, 120}, 6, 255, cv::FILLED);
  cv::GaussianBlur(blurred, blurred, {}, 1);
  SharpnessPyramid::Gauge lit;
  lit.lights = cv::Mat(120, 160, CV_8UC1, cv::Scalar(0));
  lit.lights(cv::Rect(60, 40, 40, 40)) = 255;
  const cv::Point rim(160, 127);
  const auto ratio = [&](const SharpnessPyramid::Gauge& gauge) {
    return product(blurred, gauge).at<float>(rim) / product(sharp, gauge).at<float>(rim);
  };
  EXPECT_GT(ratio({}), 10 * ratio(lit));
  const cv::Rect far(0, 0, 60, 60);
  EXPECT_EQ(cv::norm(product(blurred, {})(far), product(blurred, lit)(far), cv::NORM_INF), 0);
  lit.lights = lit.lights(cv::Rect(50, 40, 60, 45)).clone();  // levels 1 and 2 are much finer than that
  EXPECT_GT(ratio({}), ratio(lit));
}

TEST(SharpnessPyramid, HandsOutTheSharpnessOfALevel) {
  SharpnessPyramid pyramid;
  const auto texture = [&](const cv::Size& size) {
    pyramid.begin(randomGray(size), {});
    return pyramid.texture();
  };
  EXPECT_EQ(texture({200, 120}).size(), cv::Size(100, 60));
  EXPECT_GT(cv::mean(texture({200, 120}))[0], 1);
  EXPECT_EQ(texture({1280, 60}).size(), cv::Size(320, 15));
  EXPECT_EQ(texture({1280, 30}).size(), cv::Size(640, 15)) << "the coarsest there is";
  EXPECT_TRUE(texture({200, 20}).empty());
}

}  // namespace
