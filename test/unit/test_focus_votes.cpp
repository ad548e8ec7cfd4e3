// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Focus distances that were given are compared with the frames in which surfaces of known depth are sharpest.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "fusion/bracket_fusion.hpp"
#include "optics/blur_evidence.hpp"
#include "optics/focus_votes.hpp"

using namespace all_in_focus::core;

namespace {

const cv::Size kSize(320, 240);
const Optics kOptics = {50, 2.8, 0.03};
constexpr double kPixels = 1000;                         // focal length
constexpr double kFar = 1 / 4000.0, kNear = 1 / 1000.0;  // inverse distances, 1/mm
constexpr int kFrames = 9;
const cv::Point2d kCenter(159.5, 119.5);

double step() {
  return (kNear - kFar) / (kFrames - 1);
}

// In dioptres, near first, in even steps.
std::vector<double> sweep() {
  std::vector<double> mm(kFrames);
  for (int k = 0; k < kFrames; ++k) mm[k] = 1 / (kNear - k * step());
  return mm;
}

// Surfaces in bands, from far to near.
double inverseDepthAt(int x) {
  return kFar + (kNear - kFar) * (x / 20) / 15;
}

cv::Mat depth() {
  cv::Mat1w mm(kSize);
  for (int x = 0; x < kSize.width; ++x) mm.col(x) = static_cast<std::uint16_t>(1 / inverseDepthAt(x) + 0.5);
  return mm;
}

// What the lens makes of texture on these surfaces.
cv::Mat frame(double focus_mm, double contrast = 50) {
  cv::Mat sharp(kSize, CV_8UC3), picture(kSize, CV_8UC3), blurred;
  cv::RNG random(1);
  random.fill(sharp, cv::RNG::NORMAL, 128, contrast);
  cv::GaussianBlur(sharp, sharp, {}, 0.7);
  for (int x = 0; x < kSize.width; x += 20) {
    const double px = blurCircle(kOptics, 1 / inverseDepthAt(x), focus_mm) / (50 / kPixels);
    const cv::Mat band = sharp.colRange(x, x + 20);
    if (px > 0.1) {
      cv::GaussianBlur(band, blurred, {}, px / 4);  // reads what lies beside the band, too
    } else {
      band.copyTo(blurred);
    }
    blurred.copyTo(picture.colRange(x, x + 20));
  }
  cv::Mat noise(kSize, CV_16SC3), sum;
  cv::RNG(static_cast<std::uint64_t>(focus_mm)).fill(noise, cv::RNG::NORMAL, 0, 1);
  cv::add(picture, noise, sum, cv::noArray(), CV_8U);
  return sum;
}

cv::Mat gray(const cv::Mat& picture) {
  cv::Mat gray;
  cv::cvtColor(picture, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

FocusVotes votes(int frames = kFrames, double contrast = 50) {
  std::vector<FocusVotes::Frame> seen;
  for (int k = 0; k < frames; ++k) seen.push_back({DetailMap::of(gray(frame(sweep()[k], contrast)))});
  return FocusVotes(seen, depth(), kSize);
}

std::vector<FrameBlur> listOf(const std::vector<double>& mm, int frames = kFrames) {
  std::vector<FrameBlur> list;
  for (int k = 0; k < frames; ++k) list.push_back({1 / mm[k], 1});
  return list;
}

// Mistakes that people make.
std::vector<double> lateBy(int frames) {
  std::vector<double> mm;
  for (int k = 0; k < kFrames; ++k) mm.push_back(1 / (kNear - (k - frames) * step()));
  return mm;
}

std::vector<double> times(double factor) {
  std::vector<double> mm = sweep();
  for (double& one : mm) one *= factor;
  return mm;
}

std::vector<double> reversed() {
  std::vector<double> mm = sweep();
  std::reverse(mm.begin(), mm.end());
  return mm;
}

cv::Mat fuse(const std::vector<double>& told, std::vector<std::string>* notes = nullptr,
             bool has_depth = true) {
  BracketScene scene;
  scene.optics = kOptics;
  scene.camera = Camera{kSize, kPixels, kPixels, kCenter.x, kCenter.y, {}};
  if (has_depth) scene.depth = depth();
  BracketFusion fusion;
  fusion.begin(scene, kSize, Mode::kRefined);
  std::vector<cv::Mat> frames;
  for (const double mm : sweep()) frames.push_back(frame(mm));
  const int reference = kFrames / 2;
  for (int k = 0; k <= reference; ++k) fusion.observe(frames[k], k, told[k]);
  EXPECT_EQ(fusion.add(frames[reference], reference, told[reference]), "");
  for (int k = 0; k < kFrames; ++k) {
    if (k == reference) continue;
    EXPECT_EQ(fusion.add(frames[k], k, told[k]), "");
  }
  const FusionResult result = fusion.result();
  if (notes) *notes = result.lens_notes;
  // A bracket without depth does not keep those of the one before.
  fusion.begin({}, kSize, Mode::kRefined);
  fusion.add(frames[0], 0);
  EXPECT_TRUE(fusion.result().lens_notes.empty());
  return result.image;
}

}  // namespace

TEST(FocusVotes, ARightListIsLeftAsItIs) {
  for (const int frames : {kFrames, kFrames / 2 + 1}) {
    const auto found = votes(frames).correctionOf(listOf(sweep(), frames));
    ASSERT_TRUE(found) << frames;
    EXPECT_TRUE(found->isNone()) << frames;
  }
}

TEST(FocusVotes, SeveralFramesThatAreSharpVoteForTheirMiddle) {
  std::vector<FocusVotes::Frame> frames;
  for (const int detail : {80, 240, 400, 400, 400, 240, 80})
    frames.push_back({{cv::Mat1s(16, 16, static_cast<short>(detail)), 4}});
  const cv::Size size(64, 64);
  std::vector<FrameBlur> list;
  for (int k = 0; k < 7; ++k) list.push_back({1 / 1000.0 + (k - 3) * 5e-5, 1});
  EXPECT_NEAR(FocusVotes(frames, cv::Mat1w(size, 1000), size).support(list), 1, 1e-3);
}

TEST(FocusVotes, AListThatIsLateOrEarlyByAFrameIsNoticed) {
  for (const int frames : {kFrames, kFrames / 2 + 1}) {
    for (const int late : {1, -1}) {
      const auto found = votes(frames).correctionOf(listOf(lateBy(late), frames));
      ASSERT_TRUE(found) << late;
      EXPECT_EQ(found->shift, late);
      EXPECT_EQ(found->factor, 1);
      EXPECT_FALSE(found->reversed);
    }
  }
}

TEST(FocusVotes, FactorsAndOtherUnitsAreFound) {
  for (const double factor : {0.5, 2.0, 39.37, 1000.0}) {
    const auto found = votes().correctionOf(listOf(times(factor)));
    ASSERT_TRUE(found) << factor;
    EXPECT_NEAR(found->factor * factor, 1, 0.04) << factor;  // 0.02, a seventh of a step
    EXPECT_EQ(found->shift, 0);
  }
}

TEST(FocusVotes, AListInReverseOrderIsNoticed) {
  for (const int frames : {kFrames, kFrames / 2 + 1}) {
    const auto found = votes(frames).correctionOf(listOf(reversed(), frames));
    ASSERT_TRUE(found) << frames;
    EXPECT_TRUE(found->reversed) << frames;
  }
}

TEST(FocusVotes, NoiseAloneSaysNothing) {
  EXPECT_FALSE(votes(kFrames, 0).correctionOf(listOf(lateBy(1))));
  EXPECT_FALSE(votes(2).correctionOf(listOf(sweep(), 2)));
}

TEST(FocusVotes, DistancesOfALensThatMovesInEvenStepsAreFound) {
  std::vector<double> steps(kFrames);
  std::iota(steps.begin(), steps.end(), 7);
  const std::vector<double> found = votes().focusAt(steps);
  ASSERT_EQ(found.size(), steps.size());
  for (int k = 0; k < kFrames; ++k) EXPECT_NEAR(found[k], 1 / sweep()[k], 0.3 * step()) << k;  // 0.19
  EXPECT_TRUE(votes(kFrames, 0).focusAt(steps).empty());
  EXPECT_TRUE(votes(2).focusAt({0, 1}).empty());
}

TEST(FocusVotes, ModeRefinedCorrectsWhatItPredictsBy) {
  const cv::Mat right = fuse(sweep());
  const double without = cv::PSNR(right, fuse(sweep(), nullptr, false));
  std::vector<std::string> notes;
  for (const std::vector<double>& told : {lateBy(1), lateBy(-1), times(2)}) {
    EXPECT_GT(cv::PSNR(right, fuse(told, &notes)), without + 3) << told[0];
    ASSERT_FALSE(notes.empty());
    EXPECT_NE(notes[0].find("the frames show that the focus distances are"), std::string::npos) << notes[0];
  }
}

TEST(FocusVotes, ModeRefinedDoesWithoutDepthWhereTheListIsReversed) {
  std::vector<std::string> notes;
  EXPECT_EQ(cv::norm(fuse(reversed(), &notes), fuse(sweep(), nullptr, false), cv::NORM_INF), 0);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("reverse order"), std::string::npos) << notes[0];
}

TEST(LensFit, NamesTheUnitThatDistancesSeemToBeIn) {
  const auto note = [](double factor) {
    LensFit fit;
    fit.focus.factor = factor;
    return fit.notes(kOptics).at(0);
  };
  EXPECT_NE(note(0.00101).find("are they in mm?"), std::string::npos) << note(0.001);
  EXPECT_NE(note(25).find("are they in inches?"), std::string::npos) << note(25);
  EXPECT_NE(note(1000).find("are they in m?"), std::string::npos) << note(1000);
  EXPECT_EQ(note(2).find("are they in"), std::string::npos) << note(2);
}

TEST(LensFit, FocusDistancesThatAreCorrectedMoveTheLens) {
  const auto of = [](double mm) { return frameBlur(kOptics, 0.05, 1 / mm); };
  const std::vector<FrameBlur> halved = {of(2000), of(500)}, right = {of(4000), of(1000)};
  const FocusCorrection doubled = {false, 0, 2}, reversed = {true, 0, 1};
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(doubled.of(halved)[k].px_mm, right[k].px_mm, 1e-9 * right[k].px_mm) << k;
    EXPECT_NEAR(reversed.of(right)[k].px_mm, right[1 - k].px_mm, 1e-9 * right[k].px_mm) << k;
  }
}

// A disc covers pixels in part. So it blurs a small copy less than the same disc, drawn in the copy, would.
TEST(BlurEvidence, SmallCopiesShowTheScaleOfTheirPictures) {
  constexpr double kShrinking = 1.75;
  cv::Mat3b sharp(480, 640);
  cv::RNG random(1);
  random.fill(sharp, cv::RNG::NORMAL, 128, 50);
  cv::GaussianBlur(sharp, sharp, {}, 1);
  const auto grayCopy = [&](const cv::Mat& codes) { return gray(BlurEvidence::copyOf(codes, kShrinking)); };
  const cv::Mat3f light = linearLight(sharp, LightCurve::srgb());
  std::vector<BlurEvidence::Frame> frames;
  std::vector<FrameBlur> blur;
  for (const float radius : {0.0f, 0.9f, 1.8f, 2.7f}) {  // of a surface that the first frame shows sharp
    cv::Mat blurred;
    blurByDisc(light, radius, blurred);
    for (cv::Vec3f& pixel : cv::Mat3f(blurred)) {
      for (int c = 0; c < 3; ++c) pixel[c] = LightCurve::srgb().code(pixel[c]);
    }
    const cv::Mat1f copy = grayCopy(blurred);
    frames.push_back({copy, cv::Rect({}, copy.size())});
    blur.push_back({kFar + radius, 1});
  }
  const cv::Mat1f surface(frames[0].gray.size(), static_cast<float>(kFar));
  const BlurEvidence evidence(grayCopy(sharp), frames, LightCurve::srgb(), surface, kShrinking);
  EXPECT_GT(evidence.explained(blur, 1), 0.95);
  EXPECT_NEAR(evidence.typicalScale(blur, 1), 1, 0.04);
}
