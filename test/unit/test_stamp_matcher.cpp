// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/FocusFrame.h>
#include <gtest/gtest.h>
#include <message_filters/cache.h>
#include <sensor_msgs/Image.h>

#include <boost/make_shared.hpp>
#include <vector>

#include "stamp_matcher.hpp"

using namespace all_in_focus;
using sensor_msgs::Image;

namespace {

using Stamps = std::vector<double>;

template <typename Message>
boost::shared_ptr<Message> stamped(double stamp) {
  const auto message = boost::make_shared<Message>();
  message->header.stamp = ros::Time(stamp);
  return message;
}

sensor_msgs::ImagePtr image(double stamp, std::size_t bytes = 1) {
  const auto message = stamped<Image>(stamp);
  message->data.resize(bytes);
  return message;
}

FocusFramePtr focus(double stamp) {
  return stamped<FocusFrame>(stamp);
}

class StampMatcherTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { ros::Time::init(); }

  StampMatcher<Image, FocusFrame> matcher(std::size_t most) {
    return {most,
            [this](const auto& image, const auto& focus) {
              EXPECT_EQ(image->header.stamp, focus->header.stamp);
              matched_.push_back(image->header.stamp.toSec());
            },
            [this](const auto& image, const auto& focus) {
              EXPECT_FALSE(image && focus);
              dropped_.push_back(image ? image->header.stamp.toSec() : -focus->header.stamp.toSec());
            }};
  }

  Stamps matched_, dropped_;  // dropped_: negative for those of the second topic
};

}  // namespace

TEST_F(StampMatcherTest, MatchesEqualStampsInAnyOrderAndDropsWhatIsOlder) {
  auto m = matcher(10);
  m.add(image(1));
  m.add(image(2));
  m.add(focus(2));
  EXPECT_EQ(matched_, (Stamps{2}));
  EXPECT_EQ(dropped_, (Stamps{1}));
  m.add(focus(3));
  m.add(image(3));
  EXPECT_EQ(matched_, (Stamps{2, 3}));
  EXPECT_EQ(dropped_, (Stamps{1}));
}

TEST_F(StampMatcherTest, KeepsNoMoreThanItsLimit) {
  auto m = matcher(2);
  for (int i = 1; i <= 5; ++i) m.add(image(i));
  EXPECT_EQ(dropped_, (Stamps{1, 2, 3}));
}

TEST_F(StampMatcherTest, SurvivesTimeThatJumpsBack) {
  auto m = matcher(3);
  for (int i = 100; i < 103; ++i) m.add(image(i));
  m.forgetAfter(ros::Time(10));
  EXPECT_EQ(dropped_, (Stamps{100, 101, 102}));
  m.add(focus(10));
  m.forgetAfter(ros::Time(10));  // the other topic shows the same jump
  m.add(image(10));
  EXPECT_EQ(matched_, (Stamps{10}));
  EXPECT_EQ(dropped_, (Stamps{100, 101, 102}));
}

// Why the synchronizer is made anew: the old stamps of ExactTime would push every new one out.
TEST_F(StampMatcherTest, WithoutForgettingNothingNewWouldMatch) {
  auto m = matcher(3);
  for (int i = 100; i < 103; ++i) m.add(image(i));
  m.add(image(10));
  m.add(focus(10));
  EXPECT_TRUE(matched_.empty());
}

// Images that wait are bounded by bytes, and what waits beside them is not: focus messages come long before
// their images.
TEST_F(StampMatcherTest, ManyLargeImagesAreDroppedAndSmallPartnersAreNot) {
  auto m = matcher(64);
  for (int i = 1; i <= 20; ++i) m.add(focus(100 + i));
  const std::size_t bytes = kMaxWaitingBytes / 8;
  for (int i = 1; i <= 10; ++i) m.add(image(i, bytes));
  EXPECT_EQ(dropped_, (Stamps{1, 2}));
  for (int i = 1; i <= 20; ++i) m.add(image(100 + i, bytes));
  EXPECT_EQ(matched_.size(), 20u);
}

TEST_F(StampMatcherTest, FourImagesWaitHoweverLargeTheyAre) {
  auto m = matcher(64);
  for (int i = 1; i <= 5; ++i) m.add(image(i, kMaxWaitingBytes / 2));
  EXPECT_EQ(dropped_, (Stamps{1}));
}

// Why the scene of a bracket is not kept in a message_filters::Cache: what leaves it is always the oldest, so
// a frame that comes late finds nothing of its time.
TEST(MessageFiltersCache, CannotKeepWhatALateFrameNeeds) {
  ros::Time::init();
  message_filters::Cache<Image> cache(64);
  for (int i = 0; i <= 90; ++i) cache.add(image(10 + i / 30.0));  // 3 s of a Kinect
  EXPECT_FALSE(cache.getElemBeforeTime(ros::Time(10.5)));
  EXPECT_GT(cache.getOldestTime(), ros::Time(10.8));
}

TEST_F(StampMatcherTest, GivesAwayWhatIsNewerWhenTimeGoesBack) {
  auto m = matcher(10);
  for (int stamp : {1, 2}) m.add(image(stamp));
  m.add(focus(3));
  Stamps given;
  m.forgetAfter(ros::Time(1), [&](const auto& image, const auto& focus) {
    given.push_back(image ? image->header.stamp.toSec() : -focus->header.stamp.toSec());
  });
  EXPECT_EQ(given, (Stamps{2, -3}));
  EXPECT_TRUE(dropped_.empty());
  EXPECT_TRUE(m.holds(ros::Time(1)));
  EXPECT_FALSE(m.holds(ros::Time(2)) || m.holds(ros::Time(3)));
  m.add(focus(1));
  EXPECT_EQ(matched_, Stamps{1});
  EXPECT_FALSE(m.holds(ros::Time(1)));
}
