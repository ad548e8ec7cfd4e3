// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "fusion/bracket_fusion.hpp"
#include "fusion/exposure_matching.hpp"

using namespace all_in_focus::core;

namespace {

constexpr int kNearMm = 1000, kFarMm = 3000;
const std::vector<double> kSweep = {1000, 1200, 1500, 2000, 3000};
const cv::Size kSize(160, 120);
const cv::Rect kNear(0, 0, 80, 120), kFar(80, 0, 80, 120);

// A textured picture whose left half is near and whose right half is far, and what a lens makes of it.
struct TwoPlanes {
  explicit TwoPlanes(double contrast = 60) {
    scene.depth = cv::Mat(kSize, CV_16UC1, cv::Scalar(kFarMm));
    scene.depth(kNear) = kNearMm;
    scene.optics = {50, 4, 0.03};
    scene.camera = Camera{kSize, 1000, 1000, 79.5, 59.5, {}};
    truth.create(kSize, CV_8UC3);
    cv::RNG random(1);
    random.fill(truth, cv::RNG::NORMAL, 128, contrast);
    cv::GaussianBlur(truth, truth, {}, 0.7);
  }

  cv::Mat frame(double focus_mm, double noise = 0) const {
    cv::Mat frame = truth.clone();
    for (const auto& [half, depth] : {std::pair(kNear, kNearMm), std::pair(kFar, kFarMm)}) {
      const double blur_px = blurCircle(scene.optics, depth, focus_mm) / 0.05;  // pitch: f / fx
      if (blur_px < 0.1) continue;
      cv::Mat blurred;
      cv::GaussianBlur(truth, blurred, {}, blur_px / 4);
      blurred(half).copyTo(frame(half));
    }
    cv::Mat grain(kSize, CV_16SC3), sum;
    cv::RNG(static_cast<std::uint64_t>(focus_mm)).fill(grain, cv::RNG::NORMAL, 0, noise);
    cv::add(frame, grain, sum, cv::noArray(), CV_8U);
    return sum;
  }

  BracketScene scene;
  cv::Mat truth;
};

// Frames stand still and are equally bright here; the steps that find that out have tests of their own.
RefinedConfig inPlace() {
  RefinedConfig config;
  config.alignment = config.exposure = false;
  return config;
}

cv::Mat fuse(const TwoPlanes& planes, const BracketScene& scene, const RefinedConfig& config,
             double noise = 0, bool focus_known = true) {
  BracketFusion fusion;
  fusion.begin(scene, kSize, Mode::kRefined, config);
  for (std::size_t i = 0; i < kSweep.size(); ++i) {
    const double focus = focus_known ? kSweep[i] : kUnknownFocus;
    EXPECT_EQ(fusion.add(planes.frame(kSweep[i], noise), static_cast<int>(i), focus), "");
  }
  return fusion.result().image;
}

double psnr(const cv::Mat& a, const cv::Mat& b) {
  return cv::PSNR(a, b);
}

// Whether pictures differ by less than a gray level, root mean square. Here 0.4 is the most of what
// is sharp, 13 the least of what is not.
bool areAlike(const cv::Mat& a, const cv::Mat& b) {
  return psnr(a, b) > 20 * std::log10(255);
}

TEST(ModeRefined, TwoPlanesComeOutSharp) {
  const TwoPlanes planes;
  for (const double focus : kSweep) EXPECT_FALSE(areAlike(planes.frame(focus), planes.truth));
  EXPECT_TRUE(areAlike(fuse(planes, planes.scene, inPlace()), planes.truth));
}

TEST(ModeRefined, TwoPlanesComeOutSharpWithAllSteps) {
  const TwoPlanes planes;
  EXPECT_TRUE(areAlike(fuse(planes, planes.scene, {}), planes.truth));
}

TEST(ModeRefined, TheMeanIsBetterThanTheChoice) {
  const TwoPlanes planes;
  RefinedConfig hard = inPlace();
  hard.soft = false;
  EXPECT_GT(psnr(fuse(planes, planes.scene, inPlace(), 4), planes.truth),
            psnr(fuse(planes, planes.scene, hard, 4), planes.truth));
}

TEST(ModeRefined, TheImageIsTheSameWithoutTheChoice) {
  const TwoPlanes planes;
  for (const bool soft : {true, false}) {
    RefinedConfig with = inPlace(), without = inPlace();
    with.soft = without.soft = soft;
    without.choice = false;
    EXPECT_EQ(cv::norm(fuse(planes, planes.scene, with), fuse(planes, planes.scene, without), cv::NORM_INF),
              0);
  }
}

TEST(ModeRefined, ThePredictionDecidesWhereNoiseHidesTheTexture) {
  const TwoPlanes planes(12);
  BracketFusion fusion;
  fusion.begin(planes.scene, kSize, Mode::kRefined, inPlace());
  for (std::size_t i = 0; i < kSweep.size(); ++i) {
    fusion.add(planes.frame(kSweep[i], 2), static_cast<int>(i), kSweep[i]);
  }
  const int last = static_cast<int>(kSweep.size()) - 1;
  // 0.86 and 0.84 of the pixels; a fifth each by chance
  EXPECT_GT(cv::countNonZero(fusion.result().source_index(kNear) == 0), 0.8 * kNear.area());
  // Beside the near half its glow is expected, which these frames do not have.
  const cv::Rect far = kFar - cv::Size(9, 0) + cv::Point(9, 0);
  EXPECT_GT(cv::countNonZero(fusion.result().source_index(far) == last), 0.8 * far.area());
  RefinedConfig without_prediction = inPlace();
  without_prediction.prediction = false;
  EXPECT_GT(psnr(fusion.result().image, planes.truth),
            psnr(fuse(planes, planes.scene, without_prediction, 2), planes.truth) + 0.5);  // 0.8 dB
}

TEST(ModeRefined, WhereThereIsNearlyNoTextureFramesAreAveraged) {
  // A blurred frame is no worse there, and each further frame lowers the noise.
  const TwoPlanes planes(1);
  const double one_frame = psnr(planes.frame(kNearMm, 4)(kNear), planes.truth(kNear));
  // The mean of the sweep's five frames could gain 7 dB; it gains 5.9.
  EXPECT_GT(psnr(fuse(planes, planes.scene, inPlace(), 4)(kNear), planes.truth(kNear)), one_frame + 4);
}

TEST(ModeRefined, SharpnessAloneServesWithoutDepthCameraOrFocus) {
  const TwoPlanes planes;
  BracketScene without_depth = planes.scene, without_camera = planes.scene;
  without_depth.depth = cv::Mat();
  without_camera.camera.reset();
  RefinedConfig without_prediction = inPlace();
  without_prediction.prediction = false;
  const cv::Mat expected = fuse(planes, planes.scene, without_prediction);
  EXPECT_TRUE(areAlike(expected, planes.truth));
  EXPECT_EQ(cv::norm(fuse(planes, without_depth, inPlace()), expected, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(fuse(planes, without_camera, inPlace()), expected, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(fuse(planes, {}, inPlace()), expected, cv::NORM_INF), 0);
  const cv::Mat without_focus = fuse(planes, planes.scene, inPlace(), 0, false);
  EXPECT_LE(cv::norm(without_focus, expected, cv::NORM_INF), 1);  // gray levels
}

TEST(ModeRefined, DepthWithoutFocusDistancesChangesNothing) {
  const TwoPlanes planes;
  BracketScene without_depth = planes.scene;
  without_depth.depth = cv::Mat();
  const auto image = [&](const BracketScene& scene) {
    RefinedConfig config = inPlace();
    config.noise = false;  // without noise the mean is narrower where nothing is predicted
    BracketFusion fusion;
    fusion.begin(scene, kSize, Mode::kRefined, config);
    for (int i = 0; i < 4; ++i) EXPECT_EQ(fusion.add(planes.frame(kNearMm * (1 + 0.02 * i)), i), "");
    return fusion.result().image;
  };
  EXPECT_EQ(cv::norm(image(planes.scene), image(without_depth), cv::NORM_INF), 0);
}

TEST(ModeRefined, FramesThatAreSharpNowhereDoNotSpoilBareSurfaces) {
  // Only the near plane has texture; frames far out of focus shine on the bare one.
  const TwoPlanes planes;
  BracketFusion fusion;
  fusion.begin({}, kSize, Mode::kRefined, inPlace());
  for (int i = 0; i < 5; ++i) {
    cv::Mat frame = planes.truth.clone();
    if (i > 0) cv::GaussianBlur(frame, frame, {}, 20);
    frame(kFar) = cv::Scalar::all(i > 0 ? 110 : 100);
    fusion.add(frame, i);
  }
  const cv::Mat away_from_edge = fusion.result().image(cv::Rect(110, 0, 50, 120));
  EXPECT_LE(
      cv::norm(away_from_edge, cv::Mat(away_from_edge.size(), CV_8UC3, cv::Scalar::all(100)), cv::NORM_INF),
      1);
}

TEST(ModeRefined, AveragesNoiseOnBareSurfaces) {
  constexpr int kFrames = 16;
  constexpr double kNoise = 5;
  BracketFusion fusion;
  fusion.begin({}, kSize, Mode::kRefined, inPlace());
  for (int i = 0; i < kFrames; ++i) {
    cv::Mat frame(kSize, CV_8UC3);
    cv::RNG(i + 1).fill(frame, cv::RNG::NORMAL, 128, kNoise);
    fusion.add(frame, i);
  }
  cv::Scalar mean, deviation;
  cv::meanStdDev(fusion.result().image.reshape(1), mean, deviation);
  EXPECT_LT(deviation[0], 1.4 * kNoise / std::sqrt(kFrames));  // 1.14; of eight frames: 1.41
}

// The mean of a reference, `planes` with noise, and a frame that differs from it by noise and blur; the
// frames of `before` (by index) are only observed. How much noise they show decides the weights.
cv::Mat meanAfter(const std::vector<std::pair<int, cv::Mat>>& before, const TwoPlanes& planes,
                  int reference) {
  BracketFusion fusion;
  fusion.begin({}, kSize, Mode::kRefined, inPlace());
  for (const auto& [index, frame] : before) fusion.observe(frame, index);
  fusion.add(planes.frame(1500, 3), reference);
  fusion.add(planes.frame(3000, 3), reference + 1);
  return fusion.result().image;
}

TEST(ModeRefined, MeasuresNoiseAgainstTheFrameBeforeTheReference) {
  const TwoPlanes planes;
  const cv::Mat neighbour = planes.frame(1400, 3), reference = planes.frame(1500, 3);
  cv::Mat copied = reference.clone();  // the codec of a video changed one pixel
  copied.at<cv::Vec3b>(5, 5) += cv::Vec3b(9, 9, 9);
  const auto differs = [](const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF) > 0; };

  const cv::Mat expected = meanAfter({{5, neighbour}}, planes, 6);
  EXPECT_TRUE(differs(expected, meanAfter({}, planes, 6)));
  // A frame far from the reference differs by its blur as well.
  EXPECT_TRUE(differs(expected, meanAfter({{0, planes.frame(1000, 3)}}, planes, 6)));
  EXPECT_FALSE(differs(expected, meanAfter({{0, planes.frame(1000, 3)}, {5, neighbour}}, planes, 6)));
  // The first of many frames is compared, too.
  const cv::Mat blurred = planes.frame(1000, 3);
  EXPECT_FALSE(differs(
      expected,
      meanAfter({{0, neighbour}, {1, blurred}, {2, blurred}, {3, blurred}, {4, blurred}, {5, blurred}},
                planes, 6)));
  // Copies of the reference have no noise of their own.
  EXPECT_FALSE(differs(expected, meanAfter({{4, neighbour}, {5, reference}}, planes, 6)));
  EXPECT_TRUE(differs(expected, meanAfter({{4, neighbour}, {5, copied}}, planes, 6)));
  EXPECT_FALSE(differs(expected, meanAfter({{36, neighbour}, {39, copied}}, planes, 40)));
}

TEST(ModeRefined, PrefersAFrameThatWasNotResampledToOneThatIsAsSharp) {
  cv::Mat picture(260, 340, CV_8UC3);
  cv::RNG random(5);
  random.fill(picture, cv::RNG::NORMAL, 128, 40);
  cv::GaussianBlur(picture, picture, {}, 0.8);
  const auto frame = [&](const cv::Point& corner) {
    cv::Mat grain(240, 320, CV_8SC3), sum;
    random.fill(grain, cv::RNG::NORMAL, 0, 1);
    cv::add(picture(cv::Rect(corner, grain.size())), grain, sum, cv::noArray(), CV_8U);
    return sum;
  };
  BracketFusion fusion;
  fusion.begin({}, {320, 240}, Mode::kRefined);
  EXPECT_EQ(fusion.add(frame({10, 10}), 0), "");
  EXPECT_EQ(fusion.add(frame({16, 14}), 1), "");
  const cv::Mat seen = fusion.result().source_index(cv::Rect(20, 20, 280, 200));
  EXPECT_GT(cv::countNonZero(seen == 0), 0.85 * static_cast<double>(seen.total()));  // 0.90; by chance: half
}

TEST(ModeRefined, LightsStaySmall) {
  // A lamp is so bright that blur makes its white disc larger and no fainter; only its rim is softer.
  cv::Mat sharp(240, 320, CV_8UC3, cv::Scalar::all(80)), blurred = sharp.clone();
  cv::circle(sharp, {160, 120}, 2, cv::Scalar::all(255), cv::FILLED);
  cv::circle(blurred, {160, 120}, 4, cv::Scalar::all(255), cv::FILLED);
  cv::GaussianBlur(blurred, blurred, {}, 1);
  for (const bool sharp_first : {false, true}) {
    BracketFusion fusion;
    fusion.begin({}, sharp.size(), Mode::kRefined, inPlace());
    fusion.add(sharp_first ? sharp : blurred, 0);
    fusion.add(sharp_first ? blurred : sharp, 1);
    // 44 dB, 1.5 gray levels; the blurred frame alone: 39 dB, 3.
    EXPECT_GT(psnr(fusion.result().image, sharp), 42) << sharp_first;
  }
}

TEST(ModeRefined, WhatABrighterFrameClipsIsNotTakenForDark) {
  const cv::Rect window(100, 60, 120, 120);
  cv::Mat reference(240, 320, CV_8UC3, cv::Scalar::all(80));
  cv::Mat brighter(reference.size(), CV_8UC3, cv::Scalar::all(std::round(codeWithGain(80, 2))));
  reference(window) = cv::Scalar::all(230);
  brighter(window) = cv::Scalar::all(255);
  BracketFusion fusion;
  fusion.begin({}, reference.size(), Mode::kRefined);
  EXPECT_EQ(fusion.add(reference, 0), "");
  EXPECT_EQ(fusion.add(brighter, 1), "");
  // As white the brighter frame has a quarter of the weight; by what it shows here, 188, nine tenths.
  EXPECT_GT(fusion.result().image.at<cv::Vec3b>(120, 160)[0], 210);
}

TEST(ModeRefined, TheCameraMayBeCalibratedAtAnotherSize) {
  const TwoPlanes planes;
  BracketScene twice = planes.scene, pitch = planes.scene;
  twice.camera = Camera{kSize * 2, 2000, 2000, 159.5, 119.5, {}};
  pitch.camera->fx = 900;
  pitch.pixel_pitch_mm = 0.05;
  const cv::Mat expected = fuse(planes, planes.scene, inPlace());
  EXPECT_EQ(cv::norm(fuse(planes, twice, inPlace()), expected, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(fuse(planes, pitch, inPlace()), expected, cv::NORM_INF), 0);
}

TEST(ModeRefined, AnyFrameMayBeTheReference) {
  const TwoPlanes planes;
  for (const RefinedConfig& config : {inPlace(), RefinedConfig()}) {
    BracketFusion fusion;
    fusion.begin(planes.scene, kSize, Mode::kRefined, config);
    for (int i = 0; i < 3; ++i) fusion.observe(planes.frame(kSweep[i]), i, kSweep[i]);
    for (const int i : {3, 0, 1, 2, 4}) EXPECT_EQ(fusion.add(planes.frame(kSweep[i]), i, kSweep[i]), "");
    EXPECT_TRUE(areAlike(fusion.result().image, fuse(planes, planes.scene, config)));
    EXPECT_GT(cv::countNonZero(fusion.result().source_index(kNear) == 0),
              0.9 * kNear.area());  // all but a few
    EXPECT_GT(cv::countNonZero(fusion.result().source_index(kFar) == 4), 0.9 * kFar.area());
  }
}

TEST(ModeRefined, FewFramesAreEnough) {
  const TwoPlanes planes;
  const cv::Mat near = planes.frame(kNearMm), far = planes.frame(kFarMm);
  BracketFusion fusion;
  fusion.begin(planes.scene, kSize, Mode::kRefined);
  fusion.add(near, 0, kNearMm);
  EXPECT_EQ(cv::norm(fusion.result().image, near, cv::NORM_INF), 0);
  EXPECT_EQ(cv::countNonZero(fusion.result().source_index), 0);
  EXPECT_EQ(cv::countNonZero(fusion.result().confidence != 255), 0);
  fusion.add(far, 1, kFarMm);
  EXPECT_TRUE(areAlike(fusion.result().image, planes.truth));
}

TEST(ModeRefined, SmallFrames) {
  for (const cv::Size& size :
       {cv::Size(1, 1), cv::Size(1, 2), cv::Size(2, 2), cv::Size(3, 1), cv::Size(9, 2)}) {
    const cv::Mat frame(size, CV_8UC3, cv::Scalar(10, 20, 30));
    BracketScene scene;
    scene.depth = cv::Mat(size, CV_16UC1, cv::Scalar(1000));
    scene.camera = Camera{size, 100, 100, 0, 0, {}};
    BracketFusion fusion;
    fusion.begin(scene, size, Mode::kRefined, inPlace());
    ASSERT_NO_THROW(fusion.add(frame, 0, 1000)) << size;
    fusion.add(frame, 1, 2000);
    EXPECT_EQ(cv::norm(fusion.result().image, frame, cv::NORM_INF), 0) << size;
  }
}

TEST(ModeRefined, DoesNotDependOnTheNumberOfThreads) {
  const cv::Size size(150, 500);
  cv::Mat texture(size, CV_8UC3);
  cv::RNG(3).fill(texture, cv::RNG::NORMAL, 128, 60);
  cv::GaussianBlur(texture, texture, {}, 1.5);
  BracketScene with_depth = TwoPlanes().scene;
  with_depth.camera = Camera{size, 1000, 1000, 74.5, 249.5, {}};
  cv::resize(with_depth.depth, with_depth.depth, size, 0, 0, cv::INTER_NEAREST);
  const int threads = cv::getNumThreads();
  for (const BracketScene& scene : {with_depth, BracketScene()}) {
    cv::Mat images[3], sources[3], confidences[3];
    for (int run = 0; run < 3; ++run) {
      cv::setNumThreads(1 + run);
      BracketFusion fusion;
      fusion.begin(scene, size, Mode::kRefined);
      for (int i = 0; i < 4; ++i) {
        cv::Mat frame;
        const cv::Matx23d magnified(1 + 0.01 * i, 0, -0.75 * i, 0, 1 + 0.01 * i, -2.5 * i);
        cv::warpAffine(texture, frame, magnified, size, cv::INTER_CUBIC, cv::BORDER_REFLECT);
        cv::GaussianBlur(frame, frame, {}, 0.5 + 0.5 * i);
        EXPECT_EQ(fusion.add(frame, i, kSweep[i]), "");
      }
      images[run] = fusion.result().image;
      sources[run] = fusion.result().source_index;
      confidences[run] = fusion.result().confidence;
      EXPECT_EQ(cv::norm(images[run], images[0], cv::NORM_INF), 0);
      EXPECT_EQ(cv::norm(sources[run], sources[0], cv::NORM_INF), 0);
      EXPECT_EQ(cv::norm(confidences[run], confidences[0], cv::NORM_INF), 0);
    }
  }
  cv::setNumThreads(threads);
}

}  // namespace
