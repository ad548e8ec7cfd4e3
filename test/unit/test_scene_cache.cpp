// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <chrono>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "image_limit.hpp"
#include "open_bracket.hpp"
#include "scene_cache.hpp"
#include "stopwatch.hpp"

using namespace all_in_focus;

namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr int kWidth = 8, kHeight = 6;
constexpr double kFarTooLong = 60;  // s, of waiting that a test does not expect
constexpr int kSoon = 30000;        // ms, also on a computer with much else to do
constexpr SceneTopics kAll{true, true, true, true};

sensor_msgs::ImageConstPtr image(double stamp_s, const std::string& encoding = enc::TYPE_16UC1,
                                 const cv::Size& size = {kWidth, kHeight}) {
  std_msgs::Header header;
  header.stamp = ros::Time(stamp_s);
  OutgoingImage out(header, encoding, size);
  out.mat.setTo(1);
  return out.take();
}

LabelSet labels(double stamp_s, double focal_length_mm = 24) {
  const auto segments = boost::make_shared<SegmentArray>();
  segments->optics.focal_length_mm = focal_length_mm;
  segments->optics.aperture = 4;
  segments->optics.circle_of_confusion_mm = 0.019;
  return {image(stamp_s, enc::TYPE_32SC1), segments};
}

sensor_msgs::CameraInfoPtr cameraInfo(double fx = 50) {
  const auto info = boost::make_shared<sensor_msgs::CameraInfo>();
  info->width = kWidth, info->height = kHeight;
  info->K = {fx, 0, kWidth / 2.0, 0, fx, kHeight / 2.0, 0, 0, 1};
  return info;
}

// A scene of which everything has the stamp 10.
void fill(SceneCache& cache, double focal_length_mm = 24) {
  cache.addLabels(labels(10, focal_length_mm));
  cache.addDepth(image(10));
  cache.addMeasured(image(10));
  cache.setCamera(cameraInfo());
}

bool isWhole(const SceneMessages& scene) {
  return scene.labels.labels && scene.depth && scene.measured && scene.camera;
}

class SceneCacheTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { ros::Time::init(); }

  // What has come of waiting, a while after the call.
  std::future<SceneMessages> await(bool whole = true) {
    auto scene = std::async(std::launch::async,
                            [this, whole] { return cache_.await(ros::Time(10), 1, kFarTooLong, whole); });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return scene;
  }
  static bool isReady(const std::future<SceneMessages>& scene, int ms = 0) {
    return scene.wait_for(std::chrono::milliseconds(ms)) == std::future_status::ready;
  }

  SceneCache cache_;
};

}  // namespace

TEST_F(SceneCacheTest, WhatNobodyPublishesIsNotWaitedFor) {
  const Stopwatch watch;
  EXPECT_FALSE(cache_.await(ros::Time(10), 1, kFarTooLong, true).labels.labels);
  cache_.addLabels(labels(10));
  const SceneMessages scene = cache_.await(ros::Time(10), 1, kFarTooLong, true);
  EXPECT_TRUE(scene.labels.labels);
  EXPECT_FALSE(scene.depth || scene.measured || scene.camera);
  EXPECT_LT(watch.milliseconds(), kSoon);
}

TEST_F(SceneCacheTest, TheNewestLabelsAtOrBeforeTheFrameAreTaken) {
  for (const double stamp : {8.5, 9.5, 10.5}) cache_.addLabels(labels(stamp));
  EXPECT_EQ(cache_.await(ros::Time(10), 1, 0, false).labels.labels->header.stamp, ros::Time(9.5));
  EXPECT_FALSE(cache_.await(ros::Time(10), 0.25, 0, false).labels.labels);
  EXPECT_FALSE(cache_.await(ros::Time(8), 1, 0, false).labels.labels);
}

TEST_F(SceneCacheTest, EachPartIsWaitedForInAnyOrder) {
  cache_.expect(kAll);
  const std::vector<std::function<void()>> parts = {
      [this] { cache_.addLabels(labels(10)); }, [this] { cache_.addDepth(image(10)); },
      [this] { cache_.addMeasured(image(10)); }, [this] { cache_.setCamera(cameraInfo()); }};
  for (std::size_t first = 0; first < parts.size(); ++first) {
    cache_.clear();
    cache_.expect(kAll);
    auto scene = await();
    for (std::size_t i = 0; i < parts.size(); ++i) {
      EXPECT_FALSE(isReady(scene, 20));
      parts[(first + i) % parts.size()]();
    }
    EXPECT_TRUE(isWhole(scene.get()));
  }
}

TEST_F(SceneCacheTest, LabelsAloneAreEnoughForModePaper) {
  cache_.expect(kAll);
  cache_.addLabels(labels(10));
  EXPECT_TRUE(cache_.await(ros::Time(10), 1, kFarTooLong, false).labels.labels);
}

TEST_F(SceneCacheTest, WhatWasLostIsNotWaitedFor) {
  cache_.expect(kAll);
  fill(cache_);
  cache_.forgetAfter(ros::Time(9));
  for (const double stamp : {9.5, 10.5}) {
    cache_.addLabels(labels(stamp));
    cache_.addMeasured(image(stamp));
  }
  cache_.addDepth(image(10.5));
  const SceneMessages scene = cache_.await(ros::Time(10), 1, kFarTooLong, true);
  EXPECT_FALSE(scene.depth);
  EXPECT_EQ(scene.measured->header.stamp, ros::Time(9.5));
}

TEST_F(SceneCacheTest, WaitingEndsInTime) {
  cache_.expect(kAll);
  const Stopwatch watch;
  cache_.await(ros::Time(10), 1, 0.1, true);
  EXPECT_GE(watch.milliseconds(), 99);
  EXPECT_LT(watch.milliseconds(), kSoon);
}

TEST_F(SceneCacheTest, WaitingEndsWhenAPublisherGoes) {
  cache_.expect(kAll);
  cache_.addLabels(labels(10));
  auto scene = await();
  EXPECT_FALSE(isReady(scene));
  cache_.expect({true, false, false, false});
  EXPECT_TRUE(isReady(scene, kSoon));
}

TEST_F(SceneCacheTest, ClearingAndClosingLetGo) {
  cache_.expect(kAll);
  auto cleared = await();
  cache_.clear();
  EXPECT_TRUE(isReady(cleared, kSoon));
  cache_.expect(kAll);
  auto closed = await();
  cache_.close();
  EXPECT_TRUE(isReady(closed, kSoon));
  cache_.expect(kAll);
  EXPECT_TRUE(isReady(await(), kSoon));
}

TEST_F(SceneCacheTest, ThePixelPitchIsThatOfTheFirstLens) {
  fill(cache_, 24);
  cache_.clear();
  fill(cache_, 35);
  SharedScene shared = toScene(cache_.await(ros::Time(10), 1, 0, true), Mode::kRefined);
  EXPECT_TRUE(shared.warnings.empty());
  EXPECT_EQ(shared.scene.optics.focal_length_mm, 35);
  EXPECT_EQ(shared.scene.pixel_pitch_mm, 24 / 50.0);
  cache_.setCamera(cameraInfo(100));
  shared = toScene(cache_.await(ros::Time(10), 1, 0, true), Mode::kRefined);
  EXPECT_EQ(shared.scene.pixel_pitch_mm, 24 / 100.0);
}

TEST_F(SceneCacheTest, ModePaperTakesLabelsAlone) {
  fill(cache_);
  const SharedScene shared = toScene(cache_.await(ros::Time(10), 1, 0, true), Mode::kPaper);
  EXPECT_FALSE(shared.scene.labels.empty());
  EXPECT_TRUE(shared.scene.depth.empty() && shared.scene.measured.empty() && !shared.scene.camera);
  EXPECT_TRUE(shared.warnings.empty());
}

TEST_F(SceneCacheTest, WhatIsMissingOrBrokenIsLeftOutAndToldOf) {
  fill(cache_);
  const SceneMessages whole = cache_.await(ros::Time(10), 1, 0, true);
  const auto warningOf = [&](auto change) {
    SceneMessages scene = whole;
    change(scene);
    const SharedScene shared = toScene(scene, Mode::kRefined);
    EXPECT_EQ(shared.warnings.size(), 1u);
    EXPECT_FALSE(shared.scene.labels.empty());
    return shared.warnings.empty() ? "" : shared.warnings[0];
  };
  const std::string no_say = ": depth and optics have no say in the fusion";
  const std::string as_measured = ": filled depth counts as measured";
  EXPECT_EQ(warningOf([](SceneMessages& s) { s.depth.reset(); }),
            "no depth_registered/image in time" + no_say);
  EXPECT_EQ(warningOf([](SceneMessages& s) { s.measured.reset(); }),
            "no depth_registered/image_raw in time" + as_measured);
  EXPECT_EQ(warningOf([](SceneMessages& s) { s.camera.reset(); }), "no rgb/camera_info in time" + no_say);
  EXPECT_EQ(warningOf([](SceneMessages& s) {
              s.measured = image(10, enc::TYPE_16UC1, {4, 3});
            }),
            "depth_registered/image_raw is not of the size of depth_registered/image" + as_measured);
  EXPECT_NE(warningOf([](SceneMessages& s) { s.labels = labels(10, 0); }).find("focal length"),
            std::string::npos);
  EXPECT_NE(warningOf([](SceneMessages& s) { s.camera = cameraInfo(0); }).find("not calibrated"),
            std::string::npos);
  EXPECT_NE(warningOf([](SceneMessages& s) {
              const auto info = cameraInfo();
              info->roi.width = 4, info->roi.height = 3;
              s.camera = info;
              s.frame_size = {kWidth, kHeight};
            }).find("region of interest gives images of 4x3, but they have 8x6"),
            std::string::npos);
  EXPECT_TRUE(toScene({}, Mode::kRefined).scene.labels.empty());
}

TEST_F(SceneCacheTest, ABracketThatHasBegunKeepsItsSceneWhenTimeJumpsBack) {
  cache_.expect(kAll);
  fill(cache_);
  cache_.pin(ros::Time(10));
  cache_.pin(ros::Time(5));  // has no labels
  cache_.forgetAfter(ros::Time(1));
  EXPECT_FALSE(cache_.depthAt(ros::Time(10)));
  EXPECT_TRUE(isWhole(cache_.await(ros::Time(10), 1, kFarTooLong, true)));
  EXPECT_FALSE(cache_.await(ros::Time(10), 1, 0, true).labels.labels) << "asked for again";
  EXPECT_FALSE(cache_.await(ros::Time(5), 1, 0, true).labels.labels);
}

TEST_F(SceneCacheTest, ABracketThatWaitsForItsSceneGetsItWhenTimeJumpsBack) {
  cache_.expect(kAll);
  cache_.pin(ros::Time(10));
  cache_.addLabels(labels(10));
  auto scene = await();
  EXPECT_FALSE(isReady(scene));
  cache_.forgetAfter(ros::Time(1));
  ASSERT_TRUE(isReady(scene, kSoon));
  EXPECT_TRUE(scene.get().labels.labels);
}

TEST_F(SceneCacheTest, TheSceneOfBeforeAJumpIsNotThatOfALaterBracketOfTheSameStamp) {
  cache_.expect(kAll);
  cache_.addLabels(labels(10, 24));
  cache_.pin(ros::Time(10));
  cache_.forgetAfter(ros::Time(1));
  cache_.pin(ros::Time(10));
  cache_.addLabels(labels(10, 50));
  const SceneMessages scene = cache_.await(ros::Time(10), 1, 0, false);
  EXPECT_EQ(scene.labels.segments->optics.focal_length_mm, 50);
}

TEST(ImageLimit, BoundsNumberAndBytes) {
  sensor_msgs::Image image;
  EXPECT_EQ(imageLimit(64, image), 64u);
  image.data.resize(16 << 20);
  EXPECT_EQ(imageLimit(64, image), 16u);
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
    cache_.addLabels(labels(stamp));
  }
  const SceneMessages scene = cache_.await(ros::Time(10.51), 1, 0, true);
  ASSERT_TRUE(scene.labels.labels && scene.depth && scene.measured);
  EXPECT_EQ(scene.labels.labels->header.stamp, ros::Time(10 + 15 / 30.0));
  EXPECT_EQ(scene.depth->header.stamp, scene.labels.labels->header.stamp);
  EXPECT_EQ(scene.measured->header.stamp, scene.labels.labels->header.stamp);
}

TEST_F(SceneCacheTest, FramesThatNobodyAnnouncedMayBeLate) {
  for (int i = 0; i <= 1800; ++i) {  // 60 s of a Kinect
    const double stamp = 10 + i / 30.0;
    cache_.addDepth(image(stamp));
    cache_.addMeasured(image(stamp));
    cache_.addLabels(labels(stamp));
  }
  for (const double late : {0.1, 1.5, 3.0, 5.0, 20.0}) {
    const ros::Time frame(70.01 - late);
    cache_.frameArrived(frame);
    const SceneMessages scene = cache_.await(frame, 1, 0, true);
    ASSERT_TRUE(scene.labels.labels && scene.depth && scene.measured) << late << " s: " << scene.no_labels;
    if (late < 0.5) {
      EXPECT_GT(scene.labels.labels->header.stamp, frame - ros::Duration(0.04));
    }
  }
}

TEST_F(SceneCacheTest, TheCacheIsBoundedByBytes) {
  const int height = 1242, width = 4416;  // 22 MB of labels
  for (int i = 0; i < 40; ++i) {
    LabelSet set = labels(10 + i);
    const auto large = boost::make_shared<sensor_msgs::Image>(*set.labels);
    large->data.resize(static_cast<std::size_t>(width) * height * 4);
    set.labels = large;
    cache_.addLabels(set);
  }
  int kept = 0;
  for (int i = 0; i < 40; ++i)
    kept += cache_.await(ros::Time(10 + i), 0.5, 0, false).labels.labels != nullptr;
  EXPECT_LE(kept, static_cast<int>(kMaxWaitingBytes / (std::size_t{width} * height * 4)));
  EXPECT_GE(kept, 4);
}

TEST_F(SceneCacheTest, SilenceIsWaitedForOnce) {
  cache_.expect(kAll);
  const Stopwatch watch;
  cache_.await(ros::Time(10), 1, 0.5, true);
  EXPECT_GE(watch.milliseconds(), 499);
  for (int i = 1; i < 20; ++i) cache_.await(ros::Time(10 + i), 1, kFarTooLong, true);
  EXPECT_LT(watch.milliseconds(), kSoon);
  cache_.addLabels(labels(50));  // it speaks again
  auto scene =
      std::async(std::launch::async, [&] { return cache_.await(ros::Time(50.5), 1, kFarTooLong, false); });
  EXPECT_FALSE(isReady(scene, 500));
  cache_.addLabels(labels(51));
  EXPECT_EQ(scene.get().labels.labels->header.stamp, ros::Time(50));
}

TEST_F(SceneCacheTest, SaysWhyThereAreNoLabels) {
  const auto why = [this](double stamp) { return cache_.await(ros::Time(stamp), 1, 0, false).no_labels; };
  const auto contains = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos ? testing::AssertionSuccess()
                                                : testing::AssertionFailure() << text;
  };
  EXPECT_TRUE(contains(why(10), "is the segmenter running?"));
  cache_.addLabels(labels(10));
  EXPECT_TRUE(contains(why(13.5), "3.5 s older"));
  EXPECT_TRUE(contains(why(8), "2.0 s newer"));
  EXPECT_EQ(why(10.5), "");
  for (int i = 0; i < 6000; ++i) cache_.addLabels(labels(10 + i / 30.0));
  EXPECT_TRUE(contains(why(20), "no longer in memory"));
}
