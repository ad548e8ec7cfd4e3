// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <map>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "all_in_focus/bracket.hpp"

using namespace all_in_focus::core;

namespace {

using Kind = FrameStatus::Kind;
using Indices = std::vector<int>;

const cv::Size kSize(80, 60), kOther(60, 60), kWide(80, 45);

cv::Mat texture(const cv::Size& size = kSize, int seed = 3) {
  cv::Mat frame(size, CV_8UC3);
  cv::RNG(seed).fill(frame, cv::RNG::UNIFORM, 40, 200);
  return frame;
}

// The texture, blurred everywhere but in one vertical fifth: frame k of five is the sharpest in fifth k.
cv::Mat frameOf(int k, const cv::Size& size = kSize) {
  const cv::Mat sharp = texture(size);
  cv::Mat frame;
  cv::GaussianBlur(sharp, frame, {}, 2);
  const cv::Rect fifth(k % 5 * size.width / 5, 0, size.width / 5, size.height);
  sharp(fifth).copyTo(frame(fifth));
  return frame;
}

BracketScene twoPlanes(const cv::Size& size = kSize) {
  BracketScene scene;
  scene.labels = cv::Mat(size, CV_32SC1, cv::Scalar(1));
  scene.labels.colRange(size.width / 2, size.width) = 2;
  scene.depth = cv::Mat(size, CV_16UC1, cv::Scalar(1000));
  scene.depth.colRange(size.width / 2, size.width) = 3000;
  scene.camera = Camera{size, 100, 100, size.width / 2.0, size.height / 2.0, {}};
  return scene;
}

double different(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() ? cv::norm(a, b, cv::NORM_L1) : -1;
}

bool contains(const std::vector<std::string>& lines, const std::string& words) {
  for (const std::string& line : lines) {
    if (line.find(words) != std::string::npos) return true;
  }
  return false;
}

// A bracket whose caller keeps what it is to keep, and no more.
class Sender {
 public:
  explicit Sender(const BracketSettings& settings, const BracketScene& scene = {}) {
    bracket.begin(scene, settings, [this](int index) {
      asked.push_back(index);
      return kept.at(index);
    });
  }

  FrameStatus add(int index, const cv::Mat& frame, double focus_mm = kUnknownFocus) {
    FrameStatus status = bracket.add(frame, index, focus_mm);
    kept[index] = frame;
    for (auto it = kept.begin(); it != kept.end();)
      it = bracket.holds(it->first) ? std::next(it) : kept.erase(it);
    most_kept = std::max(most_kept, kept.size());
    return status;
  }
  void add(const Indices& indices) {
    for (const int index : indices) add(index, frameOf(index), 800 + 300 * index);
  }

  Bracket bracket;
  std::map<int, cv::Mat> kept;
  Indices asked;  // in this order
  std::size_t most_kept = 0;
};

BracketSettings settingsOf(Mode mode, int length = 0) {
  BracketSettings settings;
  settings.mode = mode;
  settings.length = length;
  return settings;
}

BracketResult fused(const BracketSettings& settings, const Indices& indices) {
  Sender sender(settings);
  sender.add(indices);
  return sender.bracket.finish();
}

// A scene with contrast of every size, as photographs have it; frames are ever so little apart.
const cv::Size kScene(160, 120);
cv::Mat sceneFrame(int k, int seed = 5) {
  cv::Mat coarse(8, 10, CV_8UC3), fine(kScene, CV_8UC3), frame;
  cv::RNG random(seed);
  random.fill(coarse, cv::RNG::UNIFORM, 60, 180);
  random.fill(fine, cv::RNG::UNIFORM, 0, 60);
  cv::resize(coarse, frame, kScene, 0, 0, cv::INTER_CUBIC);
  frame += fine;
  cv::GaussianBlur(frame, frame, {}, 0.5 + 0.1 * std::abs(k - 3));
  return frame;
}

using Change = std::function<cv::Mat(const cv::Mat&)>;

cv::Mat shifted(const cv::Mat& frame, double x, double y) {
  cv::Mat moved;
  cv::warpAffine(frame, moved, cv::Matx23d(1, 0, x, 0, 1, y), frame.size(), cv::INTER_CUBIC,
                 cv::BORDER_REFLECT);
  return moved;
}

// A finger at the border.
cv::Mat withFinger(const cv::Mat& frame) {
  cv::Mat covered = frame.clone();
  cv::rectangle(covered, {0, 0, 28, 80}, {50, 60, 80}, cv::FILLED);
  return covered;
}

// A part of the scene is twice as bright.
cv::Mat withLamp(const cv::Mat& frame) {
  cv::Mat lit = frame.clone();
  const cv::Rect part(100, 20, 50, 50);
  lit(part) *= 1.4;
  return lit;
}

cv::Mat withHand(const cv::Mat& frame) {
  cv::Mat covered = frame.clone();
  cv::ellipse(covered, {90, 70}, {70, 40}, 30, 0, 360, {120, 150, 200}, cv::FILLED);
  return covered;
}

// The odd frames that spoil a picture as the reference, and how they are called; "" = they are used.
const std::vector<std::pair<Change, std::string>> kOdd = {
    {[](const cv::Mat& frame) { return cv::Mat(frame * 0); }, "much darker than the others"},
    {[](const cv::Mat& frame) { return cv::Mat(frame * 0.3); }, "much darker than the others"},
    {[](const cv::Mat& frame) { return cv::Mat(frame * 0 + cv::Scalar::all(255)); },
     "much brighter than the others"},
    {[](const cv::Mat& frame) { return cv::Mat(frame * 1.8); }, "much brighter than the others"},
    {[](const cv::Mat& frame) { return cv::Mat(frame * 1.25); }, ""},
    {[](const cv::Mat& frame) { return shifted(frame, 5, 3); }, ""},
    {[](const cv::Mat& frame) { return shifted(frame, 50, 30); }, "something else than the others"},
    {[](const cv::Mat&) { return sceneFrame(3, 99); }, "something else than the others"},
    {withHand, "something else than the others"}};

}  // namespace

TEST(Bracket, AnOddFrameIsNotTheReference) {
  const cv::Mat truth = sceneFrame(3);
  for (const int n : {7, 8}) {
    for (std::size_t i = 0; i < kOdd.size(); ++i) {
      Sender sender(settingsOf(Mode::kRefined, n));
      for (int k = 0; k < n; ++k) sender.add(k, k == n / 2 ? kOdd[i].first(sceneFrame(k)) : sceneFrame(k));
      const BracketResult result = sender.bracket.finish();
      EXPECT_EQ(std::abs(result.reference - n / 2), 1) << i;
      EXPECT_EQ(result.rejected, kOdd[i].second.empty() ? 0 : 1) << i;
      EXPECT_NE(result.frames[n / 2].reason.find(kOdd[i].second), std::string::npos)
          << i << result.frames[n / 2].reason;
      EXPECT_FALSE(contains(result.notes, "takes its place")) << i;
      EXPECT_GT(cv::PSNR(result.image, truth), 35) << i;
      EXPECT_LE(sender.most_kept, static_cast<std::size_t>(n / 2 + 2)) << i;
    }
  }
}

// What covers little of the picture is nothing to alignment.
TEST(Bracket, WhatPassesByIsLeftOut) {
  for (const int odd : {1, 3, 4}) {
    Sender sender(settingsOf(Mode::kRefined, 8));
    for (int k = 0; k < 8; ++k) sender.add(k, k == odd ? withFinger(sceneFrame(k)) : sceneFrame(k));
    const BracketResult result = sender.bracket.finish();
    EXPECT_NE(result.reference, odd);
    EXPECT_EQ(result.rejected, 1) << odd;
    EXPECT_NE(result.frames[odd].reason.find("something else than the others"), std::string::npos) << odd;
    EXPECT_GT(cv::PSNR(result.image, sceneFrame(3)), 35) << odd;
  }
}

// Before the reference or behind it.
TEST(Bracket, WhatStaysForAFewFramesIsLeftOut) {
  for (const int first : {2, 3, 4, 5, 7}) {
    for (const int stays : {1, 2, 3}) {
      Sender sender(settingsOf(Mode::kRefined, 12)), good(settingsOf(Mode::kRefined, 12));
      const auto is_odd = [&](int k) { return k >= first && k < first + stays; };
      for (int k = 0; k < 12; ++k) {
        sender.add(k, is_odd(k) ? withFinger(sceneFrame(k)) : sceneFrame(k));
        if (!is_odd(k)) good.add(k, sceneFrame(k));
      }
      EXPECT_LE(sender.kept.size(), static_cast<std::size_t>(stays + 1)) << first;
      const BracketResult result = sender.bracket.finish();
      for (const FrameStatus& frame : result.frames)
        EXPECT_EQ(frame.kind == Kind::kRejected, is_odd(frame.index)) << first << ' ' << frame.index;
      EXPECT_FALSE(is_odd(result.reference)) << first;
      EXPECT_GT(cv::PSNR(result.image, good.bracket.finish().image), 40) << first << ' ' << stays;
    }
  }
}

TEST(Bracket, AFrameBetweenTwoHandsIsGood) {
  Sender sender(settingsOf(Mode::kRefined, 12));
  for (int k = 0; k < 12; ++k) sender.add(k, k == 7 || k == 9 ? withFinger(sceneFrame(k)) : sceneFrame(k));
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.rejected, 2);
  EXPECT_EQ(result.frames[8].kind, Kind::kUsed);
}

// A lamp that is switched on is part of the scene; nobody knows which half is wanted.
TEST(Bracket, WhatStaysToTheEndLosesNoFrame) {
  for (const int from : {5, 8, 11}) {
    Sender sender(settingsOf(Mode::kRefined, 12));
    for (int k = 0; k < 12; ++k) sender.add(k, k >= from ? withLamp(sceneFrame(k)) : sceneFrame(k));
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.used, 12) << from << result.frames[from].reason;
  }
}

TEST(Bracket, NoFrameWaitsWhereNoneMayBeHeld) {
  for (const bool sliding : {false, true}) {
    BracketSettings settings = settingsOf(Mode::kRefined, 12);
    settings.sliding = sliding;
    Sender sender(settings);
    for (int k = 0; k < 12; ++k) sender.add(k, k == 9 ? withLamp(sceneFrame(k)) : sceneFrame(k));
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.rejected, sliding ? 0 : 1) << result.frames[9].reason;
  }
}

TEST(Bracket, ExposureMayDrift) {
  for (const int reference : {0, 5, 9}) {
    BracketSettings settings = settingsOf(Mode::kRefined, 10);
    settings.reference = reference;
    Sender sender(settings);
    for (int k = 0; k < 10; ++k) sender.add(k, sceneFrame(k) * (k == 4 ? 0.1 : 1 - 0.07 * k));
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.used, 9) << reference;
    EXPECT_EQ(result.frames[4].kind, Kind::kRejected) << reference;
  }
}

TEST(Bracket, AnOddFirstFrameOfAnOpenSweepIsNotTheReference) {
  for (std::size_t i = 0; i < kOdd.size(); ++i) {
    if (kOdd[i].second.empty()) continue;
    Sender sender(settingsOf(Mode::kRefined));
    for (int k = 0; k < 7; ++k) sender.add(k, k == 0 ? kOdd[i].first(sceneFrame(k)) : sceneFrame(k));
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.reference, 1) << i;
    EXPECT_EQ(result.used, 6) << i;
    EXPECT_EQ(result.frames[0].kind, Kind::kRejected) << i;
    EXPECT_GT(cv::PSNR(result.image, sceneFrame(3)), 35) << i;
    EXPECT_LE(sender.most_kept, 2u);
  }
}

// The middle as far as known: frames to come count to the group.
TEST(Bracket, TheReferenceIsInTheMiddleOfTheLargestGroup) {
  const std::vector<std::pair<std::vector<int>, int>> cases = {{{5, 5, 5, 5, 9, 9, 9, 9, 9, 9}, 6},
                                                               {{5, 5, 5, 5, 5, 5, 9, 9, 9, 9}, 5},
                                                               {{5, 9, 5, 9, 5, 9, 5, 5, 5}, 4},
                                                               {{9, 5, 5, 5, 5, 5, 5}, 3}};
  for (const auto& [seeds, reference] : cases) {
    const int n = static_cast<int>(seeds.size());
    Sender sender(settingsOf(Mode::kRefined, n));
    for (int k = 0; k < n; ++k) sender.add(k, sceneFrame(3, seeds[k]));
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.reference, reference);
    EXPECT_EQ(result.used, std::count(seeds.begin(), seeds.end(), seeds[reference]));
  }
}

TEST(Bracket, TheReferenceThatTheUserWantsIsTrusted) {
  BracketSettings settings = settingsOf(Mode::kRefined, 7);
  settings.reference = 3;
  Sender sender(settings);
  for (int k = 0; k < 7; ++k) sender.add(k, sceneFrame(k, k == 3 ? 99 : 5));
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.reference, 3);
  EXPECT_EQ(result.used, 1);
}

TEST(Bracket, OddFramesAreHeldWithinTheLimit) {
  BracketSettings settings = settingsOf(Mode::kRefined, 30);
  settings.max_held = 16;
  Sender sender(settings);
  for (int k = 0; k < 30; ++k) sender.add(k, sceneFrame(3, k == 15 || k == 16 ? 99 : 5));
  EXPECT_LE(sender.most_kept, 17u);
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.used, 28);
  EXPECT_EQ(result.rejected, 2);
}

TEST(Bracket, MessagesCallFramesByTheirNames) {
  BracketSettings settings = settingsOf(Mode::kRefined, 3);
  settings.frame_name = [](int index) { return "picture " + std::to_string(index) + ".jpg"; };
  Sender sender(settings);
  for (int k = 0; k < 3; ++k) sender.add(k, sceneFrame(3, k == 1 ? 99 : 5));
  EXPECT_TRUE(contains(sender.bracket.finish().notes, "picture 1.jpg rejected: it shows something else"));
}

TEST(Bracket, ModePaperHoldsNoFrame) {
  Sender sender(settingsOf(Mode::kPaper, 5), twoPlanes());
  for (int i = 0; i < 5; ++i) EXPECT_EQ(sender.add(i, frameOf(i)).kind, Kind::kUsed);
  const BracketResult result = sender.bracket.finish();
  EXPECT_TRUE(sender.asked.empty());
  EXPECT_EQ(result.reference, 2);
  EXPECT_EQ(result.mode, Mode::kPaper);
  EXPECT_FALSE(result.sharpness_alone);
  EXPECT_EQ(result.used, 5);
}

TEST(Bracket, FramesBeforeTheReferenceAreHeldAndAskedForOnce) {
  Sender sender(settingsOf(Mode::kRefined, 5));
  std::vector<Kind> kinds;
  for (int i = 0; i < 5; ++i) {
    kinds.push_back(sender.add(i, frameOf(i)).kind);
    EXPECT_EQ(sender.kept.size(), i < 2 ? i + 1 : 0u);
  }
  EXPECT_EQ(kinds, (std::vector<Kind>{Kind::kHeld, Kind::kHeld, Kind::kUsed, Kind::kUsed, Kind::kUsed}));
  EXPECT_EQ(sender.asked, (Indices{0, 1}));
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.reference, 2);
  EXPECT_EQ(result.used, 5);
  for (const FrameStatus& frame : result.frames) EXPECT_EQ(frame.kind, Kind::kUsed);
}

TEST(Bracket, TheFirstFrameOfAnOpenSweepIsTheReference) {
  Sender sender(settingsOf(Mode::kRefined));
  sender.add({0, 1, 2});
  EXPECT_EQ(sender.most_kept, 0u);
  EXPECT_EQ(sender.bracket.finish().reference, 0);
}

TEST(Bracket, AnyFrameMayBeTheReference) {
  for (int reference = 0; reference < 5; ++reference) {
    BracketSettings settings = settingsOf(Mode::kRefined, 5);
    settings.reference = reference;
    const BracketResult result = fused(settings, {0, 1, 2, 3, 4});
    EXPECT_EQ(result.reference, reference);
    EXPECT_TRUE(result.notes.empty());
  }
}

TEST(Bracket, TheNearestFrameStandsInForALostReference) {
  const std::pair<Indices, int> cases[] = {{{0, 1, 3, 4}, 1}, {{0, 3, 4}, 3}, {{0, 1}, 1}, {{4}, 4}};
  for (const auto& [indices, reference] : cases) {
    const BracketResult result = fused(settingsOf(Mode::kRefined, 5), indices);
    EXPECT_EQ(result.reference, reference);
    EXPECT_EQ(result.used, static_cast<int>(indices.size()));
    EXPECT_TRUE(contains(result.notes, "takes its place"));
  }
}

TEST(Bracket, TheNearestFrameStandsInForAReferenceThatCannotBeRead) {
  Sender sender(settingsOf(Mode::kRefined, 5));
  sender.add({0, 1});
  EXPECT_EQ(sender.bracket.reject(2, "too dark\nto read\n").reason, "too dark to read");
  sender.add({3, 4});
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.reference, 1);
  EXPECT_EQ(result.used, 4);
  EXPECT_EQ(result.rejected, 1);
  EXPECT_TRUE(contains(result.notes, "frame 2 rejected: too dark to read"));
}

TEST(Bracket, NoMoreFramesAreHeldThanAllowed) {
  for (const int most : {0, 1, 2}) {
    BracketSettings settings = settingsOf(Mode::kRefined, 5);
    settings.max_held = most;
    Sender sender(settings);
    sender.add({0, 1, 2, 3, 4});
    EXPECT_EQ(sender.most_kept, most < 2 ? 0u : 2u);
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.reference, most < 2 ? 0 : 2);
    EXPECT_EQ(contains(result.notes, "the first frame is the reference, not frame 2"), most < 2);
  }
}

TEST(Bracket, SlidingHoldsNothingAndPreviewsEveryFrame) {
  BracketSettings settings = settingsOf(Mode::kRestored, 3);
  settings.sliding = true;
  Sender sender(settings, twoPlanes());
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(sender.add(i, frameOf(i), 1000 + i).kind, Kind::kUsed);
    const BracketResult preview = sender.bracket.preview();
    EXPECT_EQ(preview.used, i + 1);
    EXPECT_FALSE(preview.image.empty());
  }
  EXPECT_TRUE(contains(sender.bracket.finish().notes, "not restored: sliding"));
}

TEST(Bracket, ABracketWithoutAUsableFrameHasNoImage) {
  Sender sender(settingsOf(Mode::kRefined, 3));
  sender.add(0, cv::Mat());
  sender.bracket.reject(1, "broken");
  const BracketResult result = sender.bracket.finish();
  EXPECT_TRUE(result.image.empty());
  EXPECT_EQ(result.rejected, 2);
  EXPECT_EQ(result.frames.size(), 2u);
}

TEST(Bracket, AFrameOfAnotherSizeIsRejectedAtTheEnd) {
  for (const int other : {0, 1, 2, 3, 4}) {
    for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
      Sender sender(settingsOf(mode, 5));
      for (int i = 0; i < 5; ++i) {
        sender.add(i, frameOf(i, i == other ? kOther : kSize));
      }
      const BracketResult result = sender.bracket.finish();
      EXPECT_EQ(result.image.size(), kSize) << other;
      EXPECT_EQ(result.used, 4);
      EXPECT_EQ(result.rejected, 1);
      EXPECT_EQ(result.frames.at(other).kind, Kind::kRejected);
      EXPECT_NE(result.frames.at(other).reason.find("60x60"), std::string::npos)
          << result.frames.at(other).reason;
    }
  }
}

TEST(Bracket, ReasonsAreOneLine) {
  EXPECT_EQ(oneLine("OpenCV: error:\n> 'a'\n"), "OpenCV: error: > 'a'");
  EXPECT_EQ(oneLine("\n"), "");
  Sender sender(settingsOf(Mode::kRefined));
  EXPECT_EQ(sender.bracket.reject(0, "OpenCV: error:\n> 'a'\n").reason, "OpenCV: error: > 'a'");
}

TEST(Bracket, AFirstFrameOfAnotherSizeChangesNoPixel) {
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    for (const int length : {0, 6}) {
      BracketSettings settings = settingsOf(mode, length);
      Sender with(settings, twoPlanes()), without(settings, twoPlanes());
      with.add(0, frameOf(0, kOther), 700);
      without.bracket.reject(0, "another size");
      for (Sender* sender : {&with, &without}) sender->add({1, 2, 3, 4, 5});
      const BracketResult result = with.bracket.finish(), wanted = without.bracket.finish();
      EXPECT_EQ(result.reference, wanted.reference);
      EXPECT_EQ(different(result.image, wanted.image), 0);
      EXPECT_EQ(result.used, 5);
    }
  }
}

TEST(Bracket, FramesOfOtherSizesAreHeldWithinTheLimit) {
  BracketSettings settings = settingsOf(Mode::kRefined);
  settings.max_held = 3;
  Sender sender(settings);
  for (int i = 0; i < 40; ++i) sender.add(i, frameOf(i, i % 3 == 1 ? kOther : kSize));
  EXPECT_LE(sender.most_kept, 4u);
  EXPECT_EQ(sender.bracket.finish().rejected, 13);
}

TEST(Bracket, WhatDoesNotFitTheFramesIsLeftOutOfTheScene) {
  const std::pair<std::function<void(BracketScene&)>, std::string> cases[] = {
      {[](BracketScene& s) { s.labels = cv::Mat(kWide, CV_32SC1, cv::Scalar(1)); }, "label image refused"},
      {[](BracketScene& s) { s.labels = cv::Mat(kSize, CV_16UC1, cv::Scalar(1)); }, "label image refused"},
      {[](BracketScene& s) { s.labels.at<int>(3, 3) = -1; }, "negative label -1"},
      {[](BracketScene& s) { s.depth = cv::Mat(kWide, CV_16UC1, cv::Scalar(900)); }, "depth refused"},
      {[](BracketScene& s) { s.depth = cv::Mat(kSize, CV_32FC1, cv::Scalar(1)); }, "depth refused"},
      {[](BracketScene& s) { s.measured = cv::Mat(kWide, CV_16UC1, cv::Scalar(900)); }, "counts as measured"},
      {[](BracketScene& s) { s.camera->size = kWide; },
       "calibration of the colour camera refused: it is one of 80x45"},
      {[](BracketScene& s) { s.camera->fx = 0; }, "colour camera"},
      {[](BracketScene& s) { s.optics.aperture = -1; }, "aperture"}};
  for (const auto& [change, words] : cases) {
    BracketScene scene = twoPlanes();
    change(scene);
    BracketSettings settings = settingsOf(Mode::kRefined, 3);
    Sender sender(settings, scene);
    sender.add({0, 1, 2});
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.used, 3) << words;
    EXPECT_EQ(result.warnings.size(), 1u) << words;
    EXPECT_TRUE(contains(result.warnings, words)) << words;
    EXPECT_EQ(result.has_labels, words.find("label") == std::string::npos);

    settings.strict = true;
    Sender strict(settings, scene);
    EXPECT_THROW(strict.add({0, 1, 2}), std::invalid_argument) << words;
  }
}

TEST(Bracket, NamesTheCalibrationWhereDepthIsOfItsSize) {
  BracketScene scene = twoPlanes();
  scene.camera->size = kWide;
  scene.depth = cv::Mat(kWide, CV_16UC1, cv::Scalar(900));
  scene.labels = cv::Mat(kWide, CV_32SC1, cv::Scalar(1));
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    BracketSettings settings = settingsOf(mode);
    settings.strict = true;
    Sender strict(settings, scene);
    try {
      strict.add({0, 1, 2});
      FAIL() << "accepted";
    } catch (const std::invalid_argument& e) {
      EXPECT_NE(std::string(e.what()).find("calibration of the colour camera"), std::string::npos)
          << e.what();
    }
  }
}

TEST(Bracket, ModePaperFallsBackToSharpness) {
  BracketScene scene = twoPlanes(kWide);
  Sender sender(settingsOf(Mode::kPaper, 3), scene);
  sender.add({0, 1, 2});
  const BracketResult result = sender.bracket.finish();
  EXPECT_TRUE(result.sharpness_alone);
  EXPECT_TRUE(contains(result.warnings, "sharpness alone"));
  EXPECT_EQ(result.used, 3);
}

TEST(Bracket, WhoIsStrictIsToldOfWhatIsWrong) {
  BracketSettings settings = settingsOf(Mode::kRefined);
  settings.strict = true;
  EXPECT_THROW(fused(settings, {}), std::invalid_argument);
  settings.reference = 3;
  EXPECT_THROW(fused(settings, {0, 1, 2}), std::invalid_argument);
  Sender sender(settings);
  sender.add({0, 1});
  EXPECT_THROW(sender.add(2, frameOf(2, kOther)), std::invalid_argument);
}

TEST(Bracket, ABadFrameChangesNothing) {
  const cv::Mat gray(kSize, CV_8UC1, cv::Scalar(0)), small(10, 10, CV_8UC3, cv::Scalar::all(0));
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    BracketSettings strict = settingsOf(mode);
    strict.strict = true;
    EXPECT_THROW(Sender(strict).add(-1, frameOf(0)), std::invalid_argument);
    Sender refuses(strict), rejects(settingsOf(mode));
    refuses.add({0});
    rejects.add({0});
    int index = 0;
    for (const cv::Mat& bad : {cv::Mat(), gray, small}) {
      EXPECT_THROW(refuses.add(++index, bad), std::invalid_argument) << index;
      rejects.add(index, bad);
    }
    EXPECT_THROW(refuses.add(kNoFrame, frameOf(0)), std::invalid_argument);
    rejects.add(kNoFrame, frameOf(0));
    const BracketResult result = rejects.bracket.finish();
    EXPECT_EQ(result.used, 1);
    EXPECT_EQ(result.rejected, 4);
    EXPECT_EQ(cv::norm(result.image, fused(settingsOf(mode), {0}).image, cv::NORM_INF), 0);
  }
}

TEST(Bracket, AFrameThatIsAnotherOneWhenItIsAskedForAgainIsRejected) {
  for (const cv::Mat& other : {cv::Mat(), frameOf(0, kOther), cv::Mat(kSize, CV_8UC1, cv::Scalar(0))}) {
    Sender sender(settingsOf(Mode::kRefined, 3));
    sender.add({0});
    sender.kept[0] = other;
    sender.add({1, 2});
    const BracketResult result = sender.bracket.finish();
    EXPECT_EQ(result.used, 2);
    EXPECT_TRUE(contains(result.notes, "frame 0 rejected: frame 0 was another picture"));
  }
}

TEST(Bracket, ImpossibleFocusDistancesAreUnknown) {
  Sender sender(settingsOf(Mode::kRefined, 3), twoPlanes());
  for (int i = 0; i < 3; ++i) sender.add(i, frameOf(i), 0);
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.used, 3);
  EXPECT_TRUE(contains(result.notes, "a lens of 24 mm cannot be focused at 0 m"));
  EXPECT_TRUE(contains(result.notes, "no focus distances"));
  BracketSettings strict = settingsOf(Mode::kRefined, 3);
  strict.strict = true;
  Sender refuses(strict, twoPlanes());
  EXPECT_THROW(refuses.add(0, frameOf(0), 0), std::invalid_argument);
}

TEST(Bracket, RestoresUnlessToldToStop) {
  // Frames that do not differ in blur contradict no lens.
  const auto send = [](Sender& sender) {
    for (int i = 0; i < 5; ++i) sender.add(i, frameOf(0), 800 + 300 * i);
  };
  const auto restored = [&send](const Bracket::Progress& progress) {
    Sender sender(settingsOf(Mode::kRestored, 5), twoPlanes());
    send(sender);
    return sender.bracket.finish(progress);
  };
  Sender refined(settingsOf(Mode::kRefined, 5), twoPlanes());
  send(refined);
  const cv::Mat wanted = refined.bracket.finish().image;
  double last = 0;
  const BracketResult whole = restored([&](double done) {
    EXPECT_GE(done, last);
    last = done;
    return true;
  });
  EXPECT_EQ(whole.mode, Mode::kRestored);
  EXPECT_FALSE(whole.sharpness_alone);
  EXPECT_EQ(whole.restored_depth.size(), kSize);
  EXPECT_EQ(last, 1);
  for (const double until : {0.0, 0.3, 0.7}) {
    const BracketResult stopped = restored([&](double done) { return done < until; });
    EXPECT_TRUE(stopped.stopped);
    EXPECT_EQ(stopped.mode, Mode::kRefined);
    EXPECT_TRUE(stopped.restored_depth.empty());
    EXPECT_EQ(different(stopped.image, wanted), 0);
  }
}

TEST(Bracket, SaysWhatIsMissingForARestoration) {
  Sender sender(settingsOf(Mode::kRestored, 1), twoPlanes());
  sender.add(0, frameOf(0));
  const BracketResult result = sender.bracket.finish();
  EXPECT_TRUE(contains(result.notes, "not restored: two frames at different distances are needed"));
  EXPECT_FALSE(result.image.empty());
}

TEST(Bracket, OneBracketAfterAnother) {
  Bracket bracket;
  cv::Mat first;
  for (const cv::Size& size : {kSize, kOther, kSize}) {
    bracket.begin(twoPlanes(size), settingsOf(Mode::kRefined), {});
    for (int i = 0; i < 3; ++i) bracket.add(frameOf(i, size), i, 1000 + 500 * i);
    const BracketResult result = bracket.finish();
    EXPECT_EQ(result.image.size(), size);
    EXPECT_EQ(result.used, 3);
    if (first.empty()) first = result.image;
    EXPECT_EQ(different(result.image, first), size == kSize ? 0 : -1);
  }
}
