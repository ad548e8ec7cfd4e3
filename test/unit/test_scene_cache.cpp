// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <boost/weak_ptr.hpp>
#include <chrono>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "bracket_scene.hpp"
#include "image_limit.hpp"
#include "scene_cache.hpp"

using namespace all_in_focus;

namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr int kWidth = 8, kHeight = 6;
constexpr double kFarTooLong = 20;  // s
const cv::Size kFrame(kWidth, kHeight);

sensor_msgs::ImageConstPtr image(double stamp_s, const std::string& encoding = enc::TYPE_16UC1,
                                 const cv::Size& size = {kWidth, kHeight}) {
  std_msgs::Header header;
  header.stamp = ros::Time(stamp_s);
  const cv::Mat ones(size, cv_bridge::getCvType(encoding), cv::Scalar::all(1));
  return cv_bridge::CvImage(header, encoding, ones).toImageMsg();
}

OpticsPtr lens(double focal_length_mm = 24) {
  return boost::make_shared<OpticsMsg>(toMessage(core::Optics{focal_length_mm, 4, 0.019}));
}

sensor_msgs::CameraInfoPtr cameraInfo(double fx = 50) {
  auto info = boost::make_shared<sensor_msgs::CameraInfo>();
  info->width = kWidth, info->height = kHeight;
  info->K = {fx, 0, kWidth / 2.0, 0, fx, kHeight / 2.0, 0, 0, 1};
  return info;
}

void addLabels(SceneCache& cache, double stamp) {
  cache.addLabels(image(stamp, enc::TYPE_32SC1));
}

// A scene of which everything has the stamp 10.
void fill(SceneCache& cache) {
  cache.addDepth(image(10));
  cache.addMeasured(image(10));
  addLabels(cache, 10);
  cache.setCamera(cameraInfo());
  cache.setOptics(lens());
}

bool isWhole(const SceneMessages& scene) {
  return scene.depth && scene.measured && scene.camera && scene.optics;
}

class SceneCacheTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { ros::Time::init(); }
  void SetUp() override {
    cache_.setCamera(cameraInfo());
    cache_.setOptics(lens());
  }

  void addDepth(double stamp) {
    cache_.addDepth(image(stamp));
    cache_.addMeasured(image(stamp));
  }

  // What has come of waiting, a while after the call.
  std::future<SceneMessages> await(double stamp = 10) {
    auto scene =
        std::async(std::launch::async, [this, stamp] { return cache_.await(ros::Time(stamp), kFarTooLong); });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return scene;
  }
  // Without waiting.
  SceneMessages found(double stamp) { return cache_.await(ros::Time(stamp), 0); }
  static bool isReady(const std::future<SceneMessages>& scene, int ms = 0) {
    return scene.wait_for(std::chrono::milliseconds(ms)) == std::future_status::ready;
  }

  SceneCache cache_;
};

}  // namespace

TEST_F(SceneCacheTest, TheNewestDepthAtOrBeforeTheFrameIsTaken) {
  for (const double stamp : {8.5, 9.5, 10.5}) cache_.addDepth(image(stamp));
  EXPECT_EQ(found(10).depth->header.stamp, ros::Time(9.5));
  EXPECT_FALSE(found(8).depth);
  cache_.configure(/*by_labels=*/false, 0.25);
  EXPECT_FALSE(found(10).depth);
}

TEST_F(SceneCacheTest, ModePaperGoesByLabels) {
  cache_.configure(/*by_labels=*/true, 1);
  for (const double stamp : {8.5, 9.5, 10.5}) addLabels(cache_, stamp);
  cache_.addDepth(image(9.75));
  cache_.addDepth(image(9.5));
  const SceneMessages scene = found(10);
  EXPECT_EQ(scene.labels->header.stamp, ros::Time(9.5));
  EXPECT_EQ(scene.depth->header.stamp, ros::Time(9.5));
}

TEST_F(SceneCacheTest, EachPartIsWaitedForInAnyOrderButNotLabels) {
  const std::vector<std::function<void()>> parts = {[this] { cache_.addDepth(image(10)); },
                                                    [this] { cache_.addMeasured(image(10)); },
                                                    [this] { cache_.setCamera(cameraInfo()); }};
  for (std::size_t first = 0; first < parts.size(); ++first) {
    cache_.clear();
    cache_.setOptics(lens());
    auto scene = await();
    for (std::size_t i = 0; i < parts.size(); ++i) {
      EXPECT_FALSE(isReady(scene, 20));
      parts[(first + i) % parts.size()]();
    }
    EXPECT_TRUE(isWhole(scene.get()));
  }
}

TEST_F(SceneCacheTest, LabelsThatComeLateJoinTheScene) {
  cache_.addDepth(image(9.5));
  EXPECT_FALSE(cache_.await(ros::Time(10), 0).labels);
  cache_.addDepth(image(9.75));  // too late to be chosen
  addLabels(cache_, 9.75);
  EXPECT_FALSE(cache_.current().labels);
  for (int i = 0; i < 1000; ++i) cache_.addDepth(image(20 + i));  // drives its entry out
  addLabels(cache_, 9.5);
  EXPECT_EQ(cache_.current().labels->header.stamp, ros::Time(9.5));
  EXPECT_EQ(cache_.current().depth->header.stamp, ros::Time(9.5));
}

TEST_F(SceneCacheTest, WhatWasLostIsNotWaitedFor) {
  fill(cache_);
  cache_.forgetAfter(ros::Time(9));
  for (const double stamp : {9.5, 10.5}) cache_.addDepth(image(stamp));
  cache_.addMeasured(image(10.5));
  const SceneMessages scene = cache_.await(ros::Time(10), kFarTooLong);
  EXPECT_EQ(scene.depth->header.stamp, ros::Time(9.5));
  EXPECT_FALSE(scene.measured);
}

TEST_F(SceneCacheTest, WaitingEndsInTime) {
  const auto start = std::chrono::steady_clock::now();
  cache_.await(ros::Time(10), 0.1);
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(99));
}

TEST_F(SceneCacheTest, ClearingLetsGo) {
  auto cleared = await();
  cache_.clear();
  EXPECT_TRUE(isReady(cleared, 5000));
}

TEST_F(SceneCacheTest, ThePixelPitchIsThatOfTheCalibration) {
  fill(cache_);
  const SceneMessages scene = found(10);
  const auto pitch = [](const SceneMessages& messages, const CalibrationLens& calibration) {
    const SharedScene shared = toScene(messages, Mode::kRefined, kFrame, calibration);
    EXPECT_TRUE(shared.warnings.empty());
    EXPECT_EQ(shared.scene.optics.focal_length_mm, messages.optics ? messages.optics->focal_length_mm : 18);
    return shared.scene.calibratedPitch();
  };
  CalibrationLens of_rig, by_parameter;
  of_rig.optics = lens(18);
  by_parameter.optics = lens(18);
  by_parameter.pixel_pitch_mm = 0.004;
  SceneMessages corrected = scene, without_lens = scene;
  corrected.optics = lens(35);
  without_lens.optics.reset();
  EXPECT_EQ(pitch(scene, {}), 24 / 50.0);
  EXPECT_EQ(pitch(corrected, {}), 35 / 50.0) << "a lens that was wrong at the start";
  for (const SceneMessages& messages : {scene, corrected, without_lens}) {
    EXPECT_EQ(pitch(messages, of_rig), 18 / 50.0);
    EXPECT_EQ(pitch(messages, by_parameter), 0.004);
  }
}

TEST_F(SceneCacheTest, ModePaperTakesLabelsAlone) {
  fill(cache_);
  const SharedScene shared = toScene(found(10), Mode::kPaper, kFrame, {});
  EXPECT_FALSE(shared.scene.labels.empty());
  EXPECT_FALSE(shared.scene.depth.empty()) << "for the outputs";
  EXPECT_TRUE(shared.scene.measured.empty() && !shared.scene.camera);
  EXPECT_TRUE(shared.warnings.empty());
}

TEST_F(SceneCacheTest, WhatIsMissingOrBrokenIsLeftOutAndToldOf) {
  fill(cache_);
  const SceneMessages whole = found(10);
  const auto warningOf = [&](auto change) {
    SceneMessages scene = whole;
    change(scene);
    const SharedScene shared = toScene(scene, Mode::kRefined, kFrame, {});
    EXPECT_EQ(shared.warnings.size(), 1u);
    return shared.warnings.empty() ? "" : shared.warnings[0];
  };
  const std::string not_used = ": depth and lens data are not used";
  EXPECT_EQ(warningOf([](SceneMessages& s) { s.measured.reset(); }),
            "no depth_registered/image_raw in time: filled depth counts as measured");
  EXPECT_EQ(warningOf([](SceneMessages& s) { s.camera.reset(); }), "no rgb/camera_info in time" + not_used);
  EXPECT_EQ(warningOf([](SceneMessages& s) { s.optics.reset(); }), "no rgb/optics in time" + not_used);
  EXPECT_NE(warningOf([](SceneMessages& s) { s.optics = lens(0); }).find("focal length"), std::string::npos);
  EXPECT_NE(warningOf([](SceneMessages& s) { s.camera = cameraInfo(0); }).find("not calibrated"),
            std::string::npos);
  EXPECT_NE(warningOf([](SceneMessages& s) { s.depth = image(10, enc::RGB8); }).find("rgb8"),
            std::string::npos);
  const SharedScene none = toScene({}, Mode::kRefined, kFrame, {});
  EXPECT_TRUE(none.scene.depth.empty() && none.warnings.empty());
}

TEST_F(SceneCacheTest, ARegionOfInterestThatIsNotThatOfTheFramesIsRefused) {
  fill(cache_);
  SceneMessages scene = found(10);
  const auto info = cameraInfo();
  info->roi.width = kWidth / 2, info->roi.height = kHeight / 2;
  scene.camera = info;
  const SharedScene refused = toScene(scene, Mode::kRefined, kFrame, {});
  ASSERT_EQ(refused.warnings.size(), 1u);
  EXPECT_NE(refused.warnings[0].find("region of interest gives images of 4x3, but they have 8x6"),
            std::string::npos);
  EXPECT_TRUE(refused.scene.depth.empty() && refused.scene.labels.empty() && !refused.scene.camera);
  const SharedScene good = toScene(scene, Mode::kRefined, {kWidth / 2, kHeight / 2}, {});
  EXPECT_TRUE(good.warnings.empty());
  EXPECT_TRUE(good.scene.camera);
}

TEST_F(SceneCacheTest, ABracketThatHasBegunKeepsItsSceneWhenTimeJumpsBack) {
  fill(cache_);
  cache_.pin(ros::Time(10));
  cache_.forgetAfter(ros::Time(1));
  for (const double stamp : {0.5, 1.5}) cache_.addDepth(image(stamp));
  EXPECT_TRUE(isWhole(cache_.await(ros::Time(10), 0)));
  EXPECT_FALSE(found(9.9).depth) << "not pinned";
}

TEST_F(SceneCacheTest, ALateMessageFromBeforeAJumpDoesNotEndLaterWaits) {
  cache_.forgetAfter(ros::Time(10));
  addDepth(300);  // was still under way
  addDepth(10);
  auto scene = await(20);
  EXPECT_FALSE(isReady(scene));
  addDepth(20);
  EXPECT_EQ(scene.get().stamp, ros::Time(20));
}

TEST_F(SceneCacheTest, ImagesOutOfOrderEndNoWaitLater) {
  addDepth(10.51);
  addDepth(10.49);
  auto scene = await(10.5);
  EXPECT_TRUE(isReady(scene, 5000));
  EXPECT_EQ(scene.get().stamp, ros::Time(10.49));
}

TEST(ImageLimit, BoundsNumberAndBytes) {
  sensor_msgs::Image image;
  EXPECT_EQ(imageLimit(64, image), 64u);
  image.data.resize(16 << 20);
  EXPECT_EQ(imageLimit(64, image), 16u);
  EXPECT_EQ(imageLimit(64, image, kMaxWaitingBytes / 2), 8u);
  EXPECT_EQ(imageLimit(3, image), 3u);
  image.data.resize(100 << 20);
  EXPECT_EQ(imageLimit(64, image), 4u);
  EXPECT_EQ(imageLimit(0, image), 0u);
}

TEST_F(SceneCacheTest, WhatAnAnnouncedFrameNeedsStaysWhateverComesLater) {
  cache_.pin(ros::Time(10.51));
  for (int i = 0; i <= 3000; ++i) {  // 100 s of a Kinect
    const double stamp = 10 + i / 30.0;
    cache_.addDepth(image(stamp));
    cache_.addMeasured(image(stamp));
    addLabels(cache_, stamp);
  }
  cache_.pin(ros::Time(10.51));  // it has been announced, and begins
  const SceneMessages scene = found(10.51);
  ASSERT_TRUE(scene.labels && scene.depth && scene.measured);
  for (const auto& each : {scene.depth, scene.measured, scene.labels})
    EXPECT_EQ(each->header.stamp, ros::Time(10 + 15 / 30.0));
}

constexpr std::size_t kLargeBytes = std::size_t{4416} * 1242 * 2;  // 11 MB

sensor_msgs::ImagePtr largeImage(double stamp) {
  const auto large = boost::make_shared<sensor_msgs::Image>(*image(stamp));
  large->data.resize(kLargeBytes);
  return large;
}

// They were announced, or dropped.
TEST_F(SceneCacheTest, BracketsThatNeverComeKeepLittle) {
  std::vector<boost::weak_ptr<const sensor_msgs::Image>> all;
  for (int i = 0; i < 60; ++i) {
    const auto large = largeImage(10 + i);
    cache_.addDepth(large);
    cache_.pin(ros::Time(10 + i));
    if (i == 0) cache_.await(ros::Time(10), 0);  // this one is fused meanwhile
    all.emplace_back(large);
  }
  const auto kept = std::count_if(all.begin(), all.end(), [](const auto& depth) { return !depth.expired(); });
  EXPECT_LE(kept, static_cast<int>(kMaxWaitingBytes / kLargeBytes));  // with those that are not pinned
  EXPECT_TRUE(cache_.current().depth);
  EXPECT_TRUE(found(69).depth);
}

TEST_F(SceneCacheTest, TwentySecondsOfAnnouncedBracketsKeepLargeScenes) {
  for (int i = 0; i < 60; ++i) cache_.addDepth(largeImage(10 + i));
  for (int i = 0; i < 20; ++i) {
    cache_.addDepth(largeImage(70 + i));
    cache_.pin(ros::Time(70 + i));
  }
  for (int i = 0; i < 20; ++i) {
    cache_.addDepth(largeImage(90 + i));
    EXPECT_EQ(found(70 + i).stamp, ros::Time(70 + i));
  }
}

TEST_F(SceneCacheTest, AnImageThatBracketsShareCountsOnce) {
  cache_.configure(/*by_labels=*/false, 100);
  cache_.addDepth(largeImage(10));
  for (int i = 0; i < 60; ++i) cache_.pin(ros::Time(10 + i));
  for (int i = 0; i < 30; ++i) cache_.addDepth(largeImage(1000 + i));
  for (const double frame : {10, 69}) EXPECT_TRUE(found(frame).depth) << frame;
}

TEST_F(SceneCacheTest, BracketsThatNeverComeLeaveTheSceneThatABracketWaitsFor) {
  cache_.addDepth(largeImage(10));
  cache_.pin(ros::Time(10));
  auto waits = std::async(std::launch::async, [this] { return cache_.await(ros::Time(10), 1); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  for (int i = 1; i < 30; ++i) {
    cache_.addDepth(largeImage(10 + i));
    cache_.pin(ros::Time(10 + i));
  }
  EXPECT_TRUE(waits.get().depth);
}

// They were announced before it began with its second frame.
TEST_F(SceneCacheTest, ABracketWhoseFirstPictureIsLostHasItsSceneAndLeavesThoseOfLaterOnes) {
  for (const double stamp : {10, 20, 30}) {
    cache_.addDepth(image(stamp));
    cache_.pin(ros::Time(stamp));
  }
  for (int i = 0; i < 1000; ++i) cache_.addDepth(image(40 + i));  // drives their entries out
  cache_.pin(ros::Time(10.1));
  EXPECT_EQ(found(10.1).stamp, ros::Time(10));
  for (const double stamp : {20, 30}) EXPECT_TRUE(found(stamp).depth) << stamp;
}

// As in a bag of one bracket that is played in a loop.
TEST_F(SceneCacheTest, TheSceneOfTheNextBracketWithTheSameFirstFrameStays) {
  cache_.addDepth(image(10));
  cache_.pin(ros::Time(10));
  EXPECT_TRUE(found(10).depth);
  cache_.pin(ros::Time(10));
  EXPECT_TRUE(cache_.current().depth);
  for (int i = 0; i < 1000; ++i) cache_.addDepth(image(20 + i));
  EXPECT_TRUE(found(10).depth);
  EXPECT_FALSE(found(10).depth) << "nobody keeps it any more";
}

TEST_F(SceneCacheTest, FramesThatNobodyAnnouncedMayBeLate) {
  for (int i = 0; i <= 1800; ++i) {  // 60 s of a Kinect
    const double stamp = 10 + i / 30.0;
    cache_.addDepth(image(stamp));
    cache_.addMeasured(image(stamp));
    addLabels(cache_, stamp);
  }
  for (const double late : {0.1, 1.5, 3.0, 5.0, 20.0}) {
    const ros::Time frame(70.01 - late);
    cache_.pin(frame);
    const SceneMessages scene = found(frame.toSec());
    ASSERT_TRUE(scene.labels && scene.depth && scene.measured) << late << " s";
    if (late < 0.5) {
      EXPECT_GT(scene.depth->header.stamp, frame - ros::Duration(0.04));
    }
  }
}

TEST_F(SceneCacheTest, TheCacheIsBoundedByBytes) {
  cache_.configure(/*by_labels=*/false, 0.5);
  for (int i = 0; i < 60; ++i) {
    const auto large = largeImage(10 + i);
    cache_.addDepth(large);
  }
  int kept = 0;
  for (int i = 0; i < 60; ++i) kept += found(10 + i).depth != nullptr;
  EXPECT_LE(kept, static_cast<int>(kMaxWaitingBytes / 3 / kLargeBytes));
  EXPECT_GE(kept, 4);
}

TEST_F(SceneCacheTest, OldLabelsGoBeforeDepthAndInModePaperDepthBeforeLabels) {
  for (const bool by_labels : {false, true}) {
    cache_.clear();
    cache_.configure(by_labels, 0.5);
    constexpr int kScenes = 20;
    for (int i = 0; i < kScenes; ++i) {
      const auto labels = largeImage(10 + i);
      labels->encoding = sensor_msgs::image_encodings::TYPE_32SC1;
      cache_.addDepth(largeImage(10 + i));
      cache_.addLabels(labels);
    }
    const SceneMessages newest = found(10 + kScenes - 1);
    EXPECT_TRUE(newest.depth && newest.labels);
    int whole = 0, kept = 0;
    for (int i = 0; i < kScenes; ++i) {
      const SceneMessages scene = found(10 + i);
      whole += scene.depth && scene.labels;
      kept += (by_labels ? scene.labels : scene.depth) != nullptr;
    }
    EXPECT_GT(kept, whole);
    EXPECT_GE(kept, 5);
  }
}

TEST_F(SceneCacheTest, SilenceIsWaitedForOnce) {
  const auto start = std::chrono::steady_clock::now();
  cache_.await(ros::Time(10), 0.5);
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(499));
  for (int i = 1; i < 20; ++i) cache_.await(ros::Time(10 + i), kFarTooLong);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(19)) << "less than one time-out";
  addDepth(50);  // it speaks again
  auto scene = await(50.5);
  EXPECT_FALSE(isReady(scene, 500));
  addDepth(51);
  EXPECT_EQ(scene.get().depth->header.stamp, ros::Time(50));
}

TEST_F(SceneCacheTest, ATopicThatSendsLittleIsNotTakenForSilent) {
  addDepth(10);
  EXPECT_TRUE(cache_.await(ros::Time(10.5), 0.1).depth);  // waited in vain for a better one
  auto scene = await(20);
  std::this_thread::sleep_for(std::chrono::milliseconds(500));  // late, but far within the time-out
  EXPECT_FALSE(isReady(scene));
  addDepth(20);
  EXPECT_TRUE(scene.get().depth);
}

TEST_F(SceneCacheTest, SaysWhyThereIsNoScene) {
  const auto why = [this](double stamp) { return cache_.whyNone(ros::Time(stamp)); };
  const auto contains = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos ? testing::AssertionSuccess()
                                                : testing::AssertionFailure() << text;
  };
  EXPECT_TRUE(contains(why(10), "is depth_preprocess running?"));
  cache_.configure(/*by_labels=*/true, 1);
  EXPECT_TRUE(contains(why(10), "is the segmenter running?"));
  addLabels(cache_, 10);
  EXPECT_TRUE(contains(why(13.5), "3.5 s older"));
  EXPECT_TRUE(contains(why(8), "2.0 s newer"));
}
