// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Whether a camera moves, told without depth: by the paths of the cells of the picture from frame to frame.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "alignment/hidden_parallax.hpp"

using namespace all_in_focus::core;

namespace {

const cv::Size kSize(640, 480);
constexpr int kCells = CellShifts::kAcross * CellShifts::kDown;
constexpr int kFrames = 9;

// Of each cell and frame, px; x, y: from the middle of the picture, in units of its width.
using Shift = std::function<cv::Vec2d(int cell, double x, double y, int frame)>;

// Where a camera is that moves along a circle, and one that moves along a line.
cv::Vec2d onCircle(int frame) {
  const double angle = CV_2PI * frame / kFrames;
  return {std::cos(angle), std::sin(angle)};
}

cv::Vec2d onLine(int frame) {
  return cv::Vec2d(0.6, 0.8) * (2.0 * frame / kFrames - 1);
}

// The measured shifts are off by `noise`, px.
double parallaxOf(const Shift& shift, double noise = 0.1) {
  cv::RNG random(7);
  std::vector<CellShifts> frames(kFrames);
  std::vector<const CellShifts*> pairs;
  for (int f = 0; f < kFrames; ++f) {
    for (int i = 0; i < kCells; ++i) {
      const int column = i % CellShifts::kAcross, row = i / CellShifts::kAcross;
      const double x = (column + 0.5) / CellShifts::kAcross, y = (row + 0.5) / CellShifts::kDown;
      const cv::Vec2d of_cell = shift(i, x - 0.5, (y - 0.5) * kSize.height / kSize.width, f) +
                                cv::Vec2d(random.gaussian(noise), random.gaussian(noise));
      const cv::Matx22d information = 20 * cv::Matx22d::eye();
      frames[f].add(x, y, information, information * of_cell, 0.1);
    }
    pairs.push_back(&frames[f]);
  }
  return hiddenParallax(pairs, kSize);
}

// Inverse depth of a cell, less its mean, in standard deviations.
double relief(int cell) {
  return std::sqrt(1.5) * (cell * 37 % 3 - 1);
}

TEST(HiddenParallax, OfACameraThatMovesAlongABentPath) {
  const double parallax =
      parallaxOf([](int cell, double, double, int f) { return relief(cell) * onCircle(f); });
  EXPECT_GT(parallax, 1.5);
  EXPECT_LT(parallax, 2.1) << "a standard deviation to both sides of the mean";
}

TEST(HiddenParallax, OfASlope) {
  EXPECT_GT(parallaxOf([](int, double, double y, int f) { return 5 * y * onCircle(f); }), 0.35);
}

TEST(HiddenParallax, IsNotNotedWhereItDoesNotShow) {
  const Shift small = [](int cell, double, double, int f) { return 0.1 * relief(cell) * onCircle(f); };
  EXPECT_EQ(parallaxOf(small, 0.01), 0);
}

TEST(HiddenParallax, NoiseHasNone) {
  EXPECT_EQ(parallaxOf([](int, double, double, int) { return cv::Vec2d(); }, 1), 0);
}

// Also if it changes with focus.
TEST(HiddenParallax, DistortionHasNone) {
  const Shift radial = [](int, double x, double y, int f) {
    return 20 * (x * x + y * y) * cv::Vec2d(x, y) * (f - kFrames / 2);
  };
  EXPECT_EQ(parallaxOf(radial), 0);
}

// A tile at an edge shifts across it as its blur changes.
TEST(HiddenParallax, EdgesThatBlurHaveNone) {
  const Shift across = [](int cell, double, double, int f) {
    const double angle = cell * 2.4;
    return cv::Vec2d(std::cos(angle), std::sin(angle)) * std::sin(0.5 * f + cell % 5);
  };
  EXPECT_EQ(parallaxOf(across), 0);
}

TEST(HiddenParallax, ACameraThatTurnsHasNone) {
  const Shift turn = [](int, double x, double y, int f) {
    const cv::Vec2d turned = 6 * onCircle(f), lens = onLine(f);
    return turned + turned.dot({x, y}) * cv::Vec2d(x, y) + 10 * lens[0] * cv::Vec2d(x, y) +
           10 * lens[1] * cv::Vec2d(-y, x);
  };
  EXPECT_EQ(parallaxOf(turn), 0);
}

TEST(HiddenParallax, AHandThatMovesHasNone) {
  const Shift hand = [](int, double x, double y, int f) {
    return std::hypot(x - 0.1, y) < 0.1 ? 5 * onCircle(f) : cv::Vec2d();
  };
  EXPECT_EQ(parallaxOf(hand), 0);
}

// A lens does that, too.
TEST(HiddenParallax, AStraightPathDoesNotTell) {
  EXPECT_EQ(parallaxOf([](int cell, double, double, int f) { return relief(cell) * onLine(f); }), 0);
}

TEST(HiddenParallax, TwoFramesDoNotTell) {
  const CellShifts pair;
  EXPECT_EQ(hiddenParallax({&pair}, kSize), 0);
  EXPECT_EQ(hiddenParallax({}, kSize), 0);
}

TEST(HiddenParallax, WithoutTextureThereIsNone) {
  const CellShifts pair;
  EXPECT_EQ(hiddenParallax({&pair, &pair, &pair}, kSize), 0);
}

}  // namespace
