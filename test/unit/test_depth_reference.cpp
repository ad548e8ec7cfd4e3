// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The fast implementations give exactly what their plain definitions give, whatever the number of threads.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "all_in_focus/pipeline.hpp"
#include "reference_depth.hpp"

using namespace all_in_focus::core;

namespace {

Camera camera(int width, int height, double f) {
  return {{width, height}, f, 1.01 * f, 0.49 * width, 0.52 * height, {}};
}

Rig rigOf(const Camera& depth, const Camera& color, double degrees, const cv::Vec3d& translation_m) {
  Rig rig;
  rig.depth = depth;
  rig.color = color;
  const double half = degrees * CV_PI / 360;
  rig.depth_to_color =
      RigidTransform::fromQuaternion(0.01, -0.008, std::sin(half), std::cos(half), translation_m);
  return rig;
}

std::vector<Rig> rigs() {
  const Camera depth = camera(330, 121, 290);
  std::vector<Rig> rigs;
  for (const double scale : {1.0, 0.37, 1.6, 2.6, 5.3, 12.0}) {
    const Camera color =
        camera(cvRound(330 * std::min(scale, 3.0)), cvRound(121 * std::min(scale, 3.0)), 300 * scale);
    rigs.push_back(rigOf(depth, color, 0.4, {-0.03, 0.05, 0.04}));
  }
  for (const double degrees : {7.0, 45.0, 90.0, 180.0}) {
    rigs.push_back(rigOf(depth, camera(350, 130, 400), degrees, {0.1, -0.02, -0.3}));
    rigs.push_back(rigOf(depth, camera(350, 130, 1000), degrees, {0.1, -0.02, 0.1}));
  }
  rigs.push_back(rigOf(camera(7, 5, 6), camera(3, 2, 4), 0, {0, 0, 0}));
  rigs.push_back(rigOf(camera(1, 1, 1), camera(400, 300, 400), 0, {0, 0, 0}));
  rigs.push_back(rigOf(camera(600, 2, 500), camera(1, 300, 400), 0, {0, 0, 0}));
  Rig distorted = rigs[0];
  distorted.color.distortion = {0.1, -0.2, 0.001, -0.002, 0.05};
  rigs.push_back(distorted);
  distorted.depth.distortion = {-0.2, 0.05, 0.001, -0.002, 0.01};
  distorted.depth.fx = distorted.depth.fy = 90;  // sees far beyond the colour camera
  distorted.color.distortion = {-0.35, 0.12, 0.001, -0.001, -0.02, 0.01, 0.002, 0};
  rigs.push_back(distorted);
  return rigs;
}

// A wall, a panel before it with its shadow, noise and lost pixels: what a sensor gives.
cv::Mat sceneDepth(const cv::Size& size) {
  cv::Mat depth(size, CV_16UC1);
  cv::RNG random(3);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const int left = size.width / 3, right = 2 * size.width / 3;
      const bool low = v > size.height / 3, panel = low && u > left && u < right;
      const bool shadow = low && u <= left && u > left - 12;
      const double z = (panel ? 900.0 + u : 2800.0 + 0.5 * u + 0.8 * v) + random.gaussian(4.0);
      const bool lost = shadow || random.uniform(0, 100) < 4 || (u < 40 && v < 60);
      depth.at<std::uint16_t>(v, u) = lost ? 0 : cv::saturate_cast<std::uint16_t>(z);
    }
  }
  return depth;
}

cv::Mat noise(const cv::Size& size, int from, int to) {
  cv::Mat depth(size, CV_16UC1);
  cv::RNG random(4);
  random.fill(depth, cv::RNG::UNIFORM, from, to);
  return depth;
}

// Blocks of unknown pixels of all sizes, share of all pixels in percent.
cv::Mat withHoles(cv::Mat depth, int percent) {
  cv::RNG random(5);
  for (int area = 0; area < depth.size().area() * percent / 100;) {
    const cv::Rect all({}, depth.size());
    const cv::Rect hole(random.uniform(-5, depth.cols), random.uniform(-5, depth.rows),
                        1 << random.uniform(0, 8), 1 << random.uniform(0, 8));
    depth(hole & all) = 0;
    area += (hole & all).area();
  }
  return depth;
}

std::vector<cv::Mat> depths(const cv::Size& size) {
  cv::Mat edges = noise(size, 0, 65536);
  cv::Mat extremes = noise(size, 0, 4);
  for (auto& mm : cv::Mat_<std::uint16_t>(extremes)) mm = mm == 0 ? 0 : mm == 1 ? 1 : mm == 2 ? 2000 : 65535;
  return {sceneDepth(size),
          noise(size, 0, 4000),
          edges,
          extremes,
          withHoles(sceneDepth(size), 60),
          withHoles(noise(size, 1000, 1020), 30),
          cv::Mat::zeros(size, CV_16UC1),
          cv::Mat(size, CV_16UC1, cv::Scalar(1200))};
}

// Calls body with different numbers of threads.
void withThreads(const std::function<void()>& body) {
  const int usual = cv::getNumThreads();
  for (const int threads : {1, 2, 7}) {
    SCOPED_TRACE(cv::format("%d threads", threads));
    cv::setNumThreads(threads);
    body();
  }
  cv::setNumThreads(usual);
}

void expectSame(const cv::Mat& a, const cv::Mat& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(cv::countNonZero(a != b), 0);
}

TEST(DepthReference, RegistrationIsTheSame) {
  const auto all = rigs();
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (const Splat splat : {Splat::kPoint, Splat::kFootprint}) {
      const ReferenceRegistration reference(all[i], splat);
      DepthRegistration registration(all[i], splat);
      const auto maps = depths(all[i].depth.size);
      for (std::size_t j = 0; j < maps.size(); ++j) {
        SCOPED_TRACE(cv::format("rig %zu, splat %d, depth %zu", i, static_cast<int>(splat), j));
        const cv::Mat expected = reference.compute(maps[j]);
        withThreads([&] {
          cv::Mat registered;
          registration.compute(maps[j], registered);
          expectSame(registered, expected);
        });
      }
    }
  }
}

std::vector<cv::Size> sizes() {
  return {{640, 480}, {447, 301}, {128, 700}, {64, 5}, {65, 66},
          {1, 1},     {1, 400},   {400, 1},   {2, 3},  {15, 17}};
}

TEST(DepthReference, DilationIsTheSame) {
  for (const cv::Size& size : sizes()) {
    for (const cv::Mat& depth : depths(size)) {
      const cv::Mat expected = referenceDilation(depth);
      withThreads([&] {
        cv::Mat dilated;
        dilateDepth(depth, dilated);
        expectSame(dilated, expected);
        cv::Mat in_place = depth.clone();
        dilateDepth(in_place, in_place);
        expectSame(in_place, expected);
      });
    }
  }
}

TEST(DepthReference, DiffusionIsTheSame) {
  for (const cv::Size& size : sizes()) {
    for (const cv::Mat& depth : depths(size)) {
      cv::Mat filled = depth.clone();
      fillByDiffusion(filled);
      expectSame(filled, referenceDiffusion(depth.clone()));
    }
  }
}

TEST(DepthReference, FarSideIsTheSame) {
  for (const cv::Size& size : sizes()) {
    for (const cv::Mat& depth : depths(size)) {
      const cv::Mat expected = referenceFarSide(depth);
      withThreads([&] {
        cv::Mat filled;
        fillFromFarSide(depth, filled);
        expectSame(filled, expected);
      });
    }
  }
}

TEST(DepthReference, PreprocessingIsTheSame) {
  for (const Rig& rig : rigs()) {
    for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
      DepthPreprocessing preprocessing(rig, mode);
      const bool paper = mode == Mode::kPaper;
      const ReferenceRegistration reference(rig, paper ? Splat::kPoint : Splat::kFootprint);
      const cv::Mat depth = sceneDepth(rig.depth.size);
      cv::Mat registered, filled;
      preprocessing.compute(noise(rig.depth.size, 0, 3000), registered, filled);  // what came before is gone
      preprocessing.compute(depth, registered, filled);
      const cv::Mat expected = reference.compute(depth);
      expectSame(registered, expected);
      expectSame(filled,
                 paper ? referenceDiffusion(referenceDilation(expected)) : referenceFarSide(expected));
    }
  }
}

}  // namespace
