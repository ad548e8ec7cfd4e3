// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

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
    const FrameStatus status = bracket.add(frame, index, focus_mm);
    if (status.kind == Kind::kHeld) kept[index] = frame;
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

}  // namespace

TEST(Bracket, ModePaperHoldsNoFrame) {
  Sender sender(settingsOf(Mode::kPaper, 5), twoPlanes());
  for (int i = 0; i < 5; ++i) EXPECT_EQ(sender.add(i, frameOf(i)).kind, Kind::kUsed);
  const BracketResult result = sender.bracket.finish();
  EXPECT_TRUE(sender.asked.empty());
  EXPECT_EQ(result.reference, 2);
  EXPECT_EQ(result.fused_by, FusedBy::kRegions);
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
  EXPECT_EQ(result.fused_by, FusedBy::kSharpness);
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

TEST(Bracket, ImpossibleFocusDistancesAreUnknown) {
  Sender sender(settingsOf(Mode::kRefined, 3), twoPlanes());
  for (int i = 0; i < 3; ++i) sender.add(i, frameOf(i), 0);
  const BracketResult result = sender.bracket.finish();
  EXPECT_EQ(result.used, 3);
  EXPECT_TRUE(contains(result.notes, "a lens of 24 mm cannot be focused at 0 m"));
  EXPECT_TRUE(contains(result.notes, "no focus distances"));
}

TEST(Bracket, RestoresUnlessToldToStop) {
  const auto restored = [](const Bracket::Progress& progress) {
    Sender sender(settingsOf(Mode::kRestored, 5), twoPlanes());
    sender.add({0, 1, 2, 3, 4});
    return sender.bracket.finish(progress);
  };
  Sender refined(settingsOf(Mode::kRefined, 5), twoPlanes());
  refined.add({0, 1, 2, 3, 4});
  const cv::Mat wanted = refined.bracket.finish().image;
  double last = 0;
  const BracketResult whole = restored([&](double done) {
    EXPECT_GE(done, last);
    last = done;
    return true;
  });
  EXPECT_EQ(whole.fused_by, FusedBy::kRestored);
  EXPECT_EQ(whole.restored_depth.size(), kSize);
  EXPECT_EQ(last, 1);
  for (const double until : {0.0, 0.3, 0.7}) {
    const BracketResult stopped = restored([&](double done) { return done < until; });
    EXPECT_TRUE(stopped.stopped);
    EXPECT_EQ(stopped.fused_by, FusedBy::kPixels);
    EXPECT_TRUE(stopped.restored_depth.empty());
    EXPECT_EQ(different(stopped.image, wanted), 0);
  }
}

TEST(Bracket, SaysWhatIsMissingForARestoration) {
  Sender sender(settingsOf(Mode::kRestored, 2), twoPlanes());
  for (int i = 0; i < 2; ++i) sender.add(i, frameOf(i));
  const BracketResult result = sender.bracket.finish();
  EXPECT_TRUE(contains(result.notes, "not restored: the focus distances are unknown"));
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
