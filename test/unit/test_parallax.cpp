// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// A camera that moves while it shoots: near things move more than far ones.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "alignment/bracket_alignment.hpp"
#include "all_in_focus/bracket.hpp"
#include "bracket_drawing.hpp"
#include "frames_in_memory.hpp"
#include "fusion/bracket_fusion.hpp"

using namespace all_in_focus::core;
using bracket_drawing::kCenter;
using bracket_drawing::kSize;
using bracket_drawing::refocused;

namespace {

constexpr double kFocalPx = 400;
const std::array<int, 3> kDepths = {800, 1300, 3000};  // mm, of bands of the picture
constexpr int kBand = 48;                              // px

// Alignment that is off by less does not show: bracket_alignment.hpp does not resample for less than 0.35 px.
constexpr double kMostError = 0.1;

int depthAt(int y) {
  return kDepths[y / kBand % kDepths.size()];
}

cv::Mat depthImage() {
  cv::Mat depth(kSize, CV_16UC1);
  for (int y = 0; y < kSize.height; ++y) depth.row(y) = depthAt(y);
  return depth;
}

// Frame k of n of a camera at `place`, turned by `right` radians. It sees each depth by a similarity
// transform of its own.
cv::Mat seenFrom(const cv::Vec3d& place_mm, double right, int k, int n, const cv::Mat& depth = depthImage()) {
  cv::Mat picture(kSize, CV_8UC1);
  for (const int z : kDepths) {
    const SimilarityTransform motion{1 + place_mm[2] / z,
                                     {-kFocalPx * (place_mm[0] / z + right), -kFocalPx * place_mm[1] / z}};
    refocused(motion, k, n, 1.5).copyTo(picture, depth == z);
  }
  return picture;
}

cv::Mat coloured(const cv::Mat& gray) {
  cv::Mat picture;
  cv::cvtColor(gray, picture, cv::COLOR_GRAY2BGR);
  return picture;
}

BracketScene bands() {
  BracketScene scene;
  scene.depth = depthImage();
  scene.optics = {50, 4, 0.03};
  scene.camera = Camera{kSize, kFocalPx, kFocalPx, kCenter.x, kCenter.y, {}};
  return scene;
}

BracketAlignment begun(const cv::Mat& depth) {
  BracketAlignment alignment;
  alignment.begin(kSize, kCenter, reliefOf(depth, {}));
  return alignment;
}

TEST(Parallax, TheMotionOfACameraIsMeasured) {
  const cv::Vec3d place(6, -4, 5);
  const double right = 0.002;
  const Relief relief = reliefOf(depthImage(), {});
  BracketAlignment alignment = begun(depthImage());
  const cv::Mat reference = seenFrom({}, 0, 1, 2), frame = seenFrom(place, right, 0, 2);
  alignment.observe(reference, 0);
  alignment.observe(frame, 1);
  ASSERT_TRUE(alignment.drifts());
  const CameraMotion motion = alignment.measureMotion(reference, frame, alignment.placement(1, 0));
  const CameraPose pose = poseOf(motion, relief, kFocalPx, kSize);
  const double error_mm = kMostError / (kFocalPx * relief.deviation);  // where a parallax is off by so much
  EXPECT_NEAR(pose.place_mm[0], place[0], error_mm);
  EXPECT_NEAR(pose.place_mm[1], place[1], error_mm);
  EXPECT_NEAR(pose.place_mm[2], place[2], error_mm * 2);  // measured away from the centre only
  EXPECT_NEAR(pose.rotation[1], right, kMostError / kFocalPx + error_mm * relief.mean);
  EXPECT_NEAR(pose.rotation[0], 0, kMostError / kFocalPx + error_mm * relief.mean);
}

// In the smallest copies of the frames only three tiles have no depth edge. They fit any parallax, and here
// something has moved in each.
TEST(Parallax, FewTilesDoNotTellIt) {
  constexpr int kCell = 48;  // px
  constexpr double kMoved = 8;
  const cv::Rect tile(0, 0, 64, 64);
  const std::array<cv::Rect, 3> tiles = {tile + cv::Point(32, 24), tile + cv::Point(224, 24),
                                         tile + cv::Point(96, 152)};
  const std::array<cv::Point2d, 3> moved = {cv::Point2d(-kMoved, 0), {kMoved, 0}, {0, kMoved}};
  cv::Mat depth(kSize, CV_16UC1);
  for (int y = 0; y < kSize.height; y += kCell) {
    for (int x = 0; x < kSize.width; x += kCell)
      depth(cv::Rect(x, y, kCell, kCell) & cv::Rect({}, kSize)) = kDepths[(x + y) / kCell % kDepths.size()];
  }
  for (std::size_t i = 0; i < tiles.size(); ++i) depth(tiles[i]) = kDepths[i];
  const cv::Vec3d place(5, 9, -5);
  cv::Mat frame = seenFrom(place, 0, 0, 2, depth);
  for (std::size_t i = 0; i < tiles.size(); ++i)
    bracket_drawing::frame({1, moved[i]})(tiles[i]).copyTo(frame(tiles[i]));
  const cv::Mat reference = seenFrom({}, 0, 1, 2, depth);
  BracketAlignment alignment = begun(depth);
  alignment.observe(reference, 0);
  alignment.observe(frame, 1);
  const CameraMotion motion = alignment.measureMotion(reference, frame, alignment.placement(1, 0));
  EXPECT_LT(cv::norm(poseOf(motion, reliefOf(depth, {}), kFocalPx, kSize).place_mm - place), 0.5);
}

// From frame to frame near things move by 5 px, and by 25 in all.
TEST(Parallax, ACameraThatMovesFarIsFollowed) {
  constexpr int kFrames = 6;
  const Relief relief = reliefOf(depthImage(), {});
  BracketAlignment alignment = begun(depthImage());
  std::vector<cv::Mat> frames;
  for (int k = 0; k < kFrames; ++k) {
    frames.push_back(seenFrom({10.0 * k, 0, 0}, 0, k, kFrames));
    alignment.observe(frames[k], k);
  }
  for (const int last : {0, kFrames - 1}) {
    cv::Mat reference = frames[last];
    for (int k = 0; k < kFrames; ++k) {
      if (k == last) continue;
      const CameraMotion motion = alignment.measureMotion(reference, frames[k], alignment.placement(k, last));
      reference.release();
      EXPECT_NEAR(poseOf(motion, relief, kFocalPx, kSize).place_mm[0], 10 * (k - last), 0.5)
          << k << " from " << last;
    }
  }
}

TEST(Parallax, SmallSidewaysMotionsOfManyFramesCount) {
  BracketAlignment alignment = begun(depthImage());
  constexpr int kFrames = 8;
  for (int k = 0; k < kFrames; ++k) alignment.observe(seenFrom({0.3 * k, 0, 0}, 0, k, kFrames), k);
  EXPECT_TRUE(alignment.drifts());
}

// Either shifts the picture alike. One frame that is measured against the reference tells which it was.
TEST(Parallax, ASmallMoveIsToldFromATurn) {
  const double mm = 0.7, mean_depth_mm = 1 / reliefOf(depthImage(), {}).mean;
  for (const bool turns : {false, true}) {
    BracketAlignment alignment = begun(depthImage());
    const cv::Mat reference = seenFrom({}, 0, 1, 2);
    const cv::Mat frame = turns ? seenFrom({}, mm / mean_depth_mm, 0, 2) : seenFrom({mm, 0, 0}, 0, 0, 2);
    alignment.observe(reference, 0);
    alignment.observe(frame, 1);
    EXPECT_FALSE(alignment.drifts()) << "the pair alone does not tell";
    const CameraMotion motion = alignment.measureMotion(reference, frame, alignment.placement(1, 0));
    EXPECT_EQ(alignment.drifts(), !turns);
    EXPECT_EQ(motion.hasParallax(), !turns);
  }
}

// The corners move more than the middle where the camera turns, and as much where the picture is shifted. The
// shifts of several frames tell which it was, without the focal length.
TEST(Parallax, ATurnIsToldFromAShiftOfThePicture) {
  constexpr int kFrames = 4;
  constexpr double kPx = 6;
  const cv::Mat reference = refocused({}, 0, kFrames, 0);
  for (const bool turns : {true, false}) {
    for (const cv::Mat& depth : {cv::Mat(), depthImage()}) {
      BracketAlignment alignment = begun(depth);
      alignment.observe(reference, 0);
      for (int k = 1; k < kFrames; ++k) {
        const double angle = kPx * k / kFrames / kFocalPx, c = std::cos(angle), s = std::sin(angle);
        const cv::Matx33d camera(kFocalPx, 0, kCenter.x, 0, kFocalPx, kCenter.y, 0, 0, 1);
        const cv::Matx33d turned = camera * cv::Matx33d(c, 0, s, 0, 1, 0, -s, 0, c) * camera.inv(),
                          shifted(1, 0, kPx * k / kFrames, 0, 1, 0, 0, 0, 1);
        cv::Mat frame;
        cv::warpPerspective(reference, frame, turns ? turned : shifted, kSize, cv::INTER_CUBIC,
                            cv::BORDER_REFLECT_101);
        alignment.observe(frame, k);
        const CameraMotion motion =
            alignment.measureMotion(k == 1 ? reference : cv::Mat(), frame, alignment.placement(k, 0));
        EXPECT_FALSE(alignment.drifts());
        EXPECT_FALSE(motion.hasParallax());
        EXPECT_EQ(motion.isSimilarity(), !turns) << k;
        if (!turns) continue;
        for (const cv::Point2d& p : {cv::Point2d(0, 0), cv::Point2d(kSize.width - 1, kSize.height / 2.0)}) {
          const cv::Vec3d there = turned * cv::Vec3d(p.x, p.y, 1);
          EXPECT_LT(cv::norm(motion.apply(p, 0, kCenter, kSize) -
                             cv::Point2d(there[0] / there[2], there[1] / there[2])),
                    kMostError)
              << k;
        }
      }
    }
  }
}

// Only the camera's place makes a parallax: not the lens, not a turn, not the order of blur and depth.
TEST(Parallax, NothingElseMakesOne) {
  BracketAlignment with_depth = begun(depthImage()), without = begun({});
  constexpr int kFrames = 8;
  for (int k = 0; k < kFrames; ++k) {
    const SimilarityTransform motion{1 + 0.002 * (k - 4), {0.4 * k, -0.3 * k}, 0.0005 * k};
    const cv::Mat frame = refocused(motion, k, kFrames);
    with_depth.observe(frame, k);
    without.observe(frame, k);
  }
  EXPECT_FALSE(with_depth.drifts());
  for (int k = 0; k < kFrames; ++k) {
    const Placement a = with_depth.placement(k, 4), b = without.placement(k, 4);
    EXPECT_TRUE(a.scale == b.scale && a.shift == b.shift && a.angle == b.angle) << "bit for bit, frame " << k;
  }
}

TEST(Parallax, FlatOrUnknownDepthHasNoRelief) {
  EXPECT_FALSE(reliefOf({}, {}).isKnown());
  EXPECT_FALSE(reliefOf(cv::Mat(kSize, CV_16UC1, cv::Scalar(0)), {}).isKnown());
  EXPECT_FALSE(reliefOf(cv::Mat(kSize, CV_16UC1, cv::Scalar(900)), {}).isKnown());
  EXPECT_TRUE(reliefOf(depthImage(), {}).isKnown());
  EXPECT_FALSE(reliefOf(depthImage(), cv::Mat(kSize, CV_16UC1, cv::Scalar(0))).isKnown());
}

TEST(Parallax, PixelsWithoutDepthHaveTheNearestOne) {
  cv::Mat depth = depthImage();
  depth.colRange(0, 30) = 0;
  depth.rowRange(0, 5) = 0;
  const cv::Mat1f relief = reliefImage(reliefOf(depth, {}), kSize),
                  whole = reliefImage(reliefOf(depth, {}), kSize / 2);
  EXPECT_EQ(relief(20, 0), relief(20, 100));
  EXPECT_EQ(relief(0, 100), relief(20, 100));
  EXPECT_EQ(whole(10, 0), relief(20, 100)) << "of any size";
}

TEST(Parallax, SpecksOfWrongDepthAreLeftOut) {
  cv::Mat depth = depthImage();
  const cv::Mat1f clean = reliefImage(reliefOf(depthImage(), {}), kSize);
  depth(cv::Rect(100, 20, 3, 3)) = 2000;
  const cv::Mat1f relief = reliefImage(reliefOf(depth, depthImage()), kSize);
  EXPECT_EQ(cv::norm(relief, clean, cv::NORM_INF), 0);
  cv::Mat lonely(kSize, CV_16UC1, cv::Scalar(0));
  lonely.at<std::uint16_t>(100, 100) = 2000;
  EXPECT_EQ(cv::norm(reliefImage(reliefOf(lonely, depthImage()), kSize)), 0) << "nothing is left";
}

// A post before a wall; the camera moves to the right, so that the post hides what is to its left.
struct PostBeforeAWall {
  PostBeforeAWall() {
    depth = cv::Mat(kSize, CV_16UC1, cv::Scalar(3000));
    depth(post) = 1000;
    relief = reliefOf(depth, {});
    motion.parallax = {-4 / (relief.of(1000) - relief.of(3000)), 0, 0};
    motion.shift.x = -motion.parallax[0] * relief.of(3000);  // the wall stays, the post moves by 4 px
  }
  cv::Rect post{100, 0, 60, kSize.height};
  cv::Mat depth;
  Relief relief;
  CameraMotion motion;
};

TEST(Parallax, WhatIsNearerHides) {
  const PostBeforeAWall scene;
  const ParallaxView view = viewOf(scene.motion, reliefImage(scene.relief, kSize), kCenter);
  EXPECT_NEAR(view.map(100, 130)[0], 126, 1e-3);
  EXPECT_NEAR(view.map(20, 30)[0], 30, 1e-3);
  const cv::Rect moved = scene.post - cv::Point(4, 0),
                 around(moved.tl() - cv::Point(1, 1), moved.size() + cv::Size(2, 2));
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const cv::Point p(x, y);
      if (scene.post.contains(p)) {
        EXPECT_EQ(view.shown(p), 255) << p;
      } else if (moved.contains(p)) {
        EXPECT_EQ(view.shown(p), 0) << p;
      } else if (!around.contains(p)) {  // there the post may cover a part of a pixel
        EXPECT_EQ(view.shown(p), 255) << p;
      }
    }
  }
}

TEST(Parallax, WhatLeavesThePictureIsNotShown) {
  CameraMotion motion;
  motion.shift = {3, 0};
  const ParallaxView view = viewOf(motion, reliefImage(reliefOf(depthImage(), {}), kSize), kCenter);
  EXPECT_EQ(cv::countNonZero(view.shown), (kSize.width - 3) * kSize.height);
}

// The frames before and behind the reference are much sharper there, and yet count for nothing.
TEST(Parallax, HiddenPixelsAreThoseOfTheReference) {
  cv::Mat blurred = seenFrom({}, 0, 1, 2);
  cv::GaussianBlur(blurred, blurred, {}, 1);
  const cv::Mat moved = seenFrom({0, 12, 0}, 0, 1, 2);
  BracketFusion fusion;
  fusion.begin(bands(), kSize, Mode::kRefined);
  cv::Mat hidden;
  fusion.setAlignedFrameCallback([&](const AlignedFrame& frame) {
    if (frame.index == 1) cv::Mat(frame.opaque == 0).copyTo(hidden);
  });
  ASSERT_EQ(fusion.add(coloured(blurred), 0), "");
  ASSERT_EQ(fusion.add(coloured(moved), 1), "");
  // Bands that are nearer move up by 6 or 4 px, bands at 3 m by 1.6.
  ASSERT_GT(cv::countNonZero(hidden), 3 * kSize.width);
  ASSERT_LT(cv::countNonZero(hidden), 30 * kSize.width);
  cv::Mat difference;
  const FusionResult result = fusion.result();
  cv::absdiff(result.image, coloured(blurred), difference);
  EXPECT_GT(cv::mean(difference, hidden == 0)[0], 2) << "the sharper frame is used where it can be";
  EXPECT_EQ(cv::norm(difference, cv::NORM_INF, hidden), 0);
  ASSERT_EQ(result.notes.size(), 1);
  EXPECT_NE(result.notes[0].find("the camera moved by up to 1"), std::string::npos) << result.notes[0];
}

// What a bracket of a camera that moves slowly has become, and what it has asked for.
struct SlowBracket {
  BracketResult result;
  std::vector<int> fused, asked;  // indices, in order
  std::size_t most_kept = 0;
};

constexpr int kSlowFrames = 8;

// Drawn once, for that takes longer than to fuse it.
cv::Mat slowFrame(int k) {
  static std::map<int, cv::Mat> drawn;
  cv::Mat& frame = drawn[k];
  if (frame.empty()) frame = coloured(seenFrom({0.3 * k, 0, 0}, 0, k, kSlowFrames));
  return frame;
}

cv::Mat anotherScene() {
  cv::Mat frame(kSize, CV_8UC3);
  cv::RNG(7).fill(frame, cv::RNG::UNIFORM, 40, 200);
  return frame;
}

// odd: frames that show another scene.
SlowBracket slowBracket(int max_held, const std::set<int>& odd = {}) {
  SlowBracket slow;
  BracketSettings settings;
  settings.max_held = max_held;
  settings.on_aligned = [&](const AlignedFrame& frame) { slow.fused.push_back(frame.index); };
  std::map<int, cv::Mat> kept;
  Bracket bracket;
  bracket.begin(bands(), settings, [&](int index) {
    slow.asked.push_back(index);
    return kept.at(index);
  });
  for (int k = 0; k < kSlowFrames; ++k) {
    kept[k] = odd.count(k) > 0 ? anotherScene() : slowFrame(k);
    bracket.add(kept[k], k);
    for (int i = 0; i <= k; ++i) {
      if (!bracket.holds(i)) kept.erase(i);
    }
    slow.most_kept = std::max(slow.most_kept, kept.size());
  }
  for (const auto& frame : kept)
    EXPECT_EQ(odd.count(frame.first), 1u) << "that the camera moves is known: no frame need be fused anew";
  slow.result = bracket.finish();
  return slow;
}

// With depth a bracket keeps what it may have to fuse anew, as long as frames may come.
TEST(Parallax, ABracketThatIsFinishedHoldsNoFrame) {
  Bracket bracket;
  bracket.begin(bands(), {}, [](int) { return cv::Mat(); });
  for (int k = 0; k < 3; ++k) bracket.add(slowFrame(0), k);
  EXPECT_TRUE(bracket.holds(1));
  bracket.finish();
  for (int k = 0; k < 3; ++k) EXPECT_FALSE(bracket.holds(k)) << k;
}

// That the camera moves shows after some frames. They are fused anew, as if it had been known from the first.
TEST(Parallax, FramesBeforeItShowsAreFusedAnew) {
  const SlowBracket slow = slowBracket(kNoFrame);
  const int before = static_cast<int>(slow.fused.size()) - kSlowFrames;
  ASSERT_GT(before, 2);
  ASSERT_LE(before, kSlowFrames) << "once";
  std::vector<int> expected;
  for (int k = 0; k < before; ++k) expected.push_back(k);
  EXPECT_EQ(slow.asked, std::vector<int>(expected.begin(), expected.end() - 1)) << "the newest is there";
  for (int k = 0; k < kSlowFrames; ++k) expected.push_back(k);
  EXPECT_EQ(slow.fused, expected);
  EXPECT_EQ(slow.result.used, kSlowFrames);

  BracketFusion fusion;
  fusion.begin(bands(), kSize, Mode::kRefined, {}, /*drifts=*/true);
  for (int k = 0; k < kSlowFrames; ++k) ASSERT_EQ(fusion.add(slowFrame(k), k), "");
  EXPECT_EQ(cv::norm(slow.result.image, fusion.result().image, cv::NORM_INF), 0);
}

// They wait for the end, and are judged like the others after the bracket has started over.
TEST(Parallax, OddFramesBeforeItShowsAreLeftOut) {
  const std::set<int> odd = {2, kSlowFrames - 1};
  const SlowBracket slow = slowBracket(kNoFrame, odd);
  EXPECT_GT(slow.fused.size(), kSlowFrames - odd.size()) << "it has started over";
  for (const FrameStatus& frame : slow.result.frames) {
    EXPECT_EQ(frame.kind == FrameStatus::Kind::kRejected, odd.count(frame.index) > 0) << frame.index;
    EXPECT_EQ(frame.reason.find("another scene") != std::string::npos, odd.count(frame.index) > 0)
        << frame.reason;
  }
}

// As a video does.
class ReadIntoOneBuffer : public FrameSource {
 public:
  bool next(cv::Mat& frame) override {
    if (next_ == kSlowFrames) return false;
    slowFrame(next_++).copyTo(frame);
    return true;
  }
  void rewind() override { next_ = 0; }
  int count() override { return kSlowFrames; }

 private:
  int next_ = 0;
};

// The newest one, too, although frames are read between its coming and its fusion.
TEST(Parallax, FramesThatAreFusedAnewHaveTheirOwnPixels) {
  std::vector<cv::Mat> frames;
  for (int k = 0; k < kSlowFrames; ++k) frames.push_back(slowFrame(k));
  FramesInMemory from_memory(frames);
  ReadIntoOneBuffer from_buffer;
  PipelineInput input;
  input.registered_depth = depthImage();
  input.optics = bands().optics;
  input.reference = 0;
  const auto fused = [&input](FrameSource& source) {
    input.frames = &source;
    return Pipeline(Mode::kRefined).run(input).bracket.image;
  };
  EXPECT_EQ(cv::norm(fused(from_buffer), fused(from_memory), cv::NORM_INF), 0);
}

TEST(Parallax, NoMoreFramesAreKeptThanMayBeHeld) {
  for (const int max_held : {0, 2, 3}) {
    for (const std::set<int>& odd : {std::set<int>{}, {1, 3}}) {
      const SlowBracket slow = slowBracket(max_held, odd);
      EXPECT_EQ(slow.most_kept, static_cast<std::size_t>(max_held)) << odd.size();
      EXPECT_EQ(slow.fused.size(), kSlowFrames - odd.size()) << max_held;
      const std::string words = cv::format("at most %d frames are held", max_held);
      EXPECT_EQ(std::count_if(slow.result.notes.begin(), slow.result.notes.end(),
                              [&](const std::string& note) { return note.find(words) == 0; }),
                1)
          << max_held << ' ' << odd.size();
    }
  }
  for (const std::string& note : slowBracket(kNoFrame).result.notes)
    EXPECT_EQ(note.find("frames are held"), std::string::npos) << note;
}

}  // namespace
