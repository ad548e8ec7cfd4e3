// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cstdint>
#include <stdexcept>

#include "time_jumps.hpp"

using namespace all_in_focus;

namespace {

// As a message may hold it; the constructor of ros::Time refuses what is beyond a second.
ros::Time received(std::uint32_t sec, std::uint32_t nsec) {
  ros::Time time;
  time.sec = sec;
  time.nsec = nsec;
  return time;
}
const ros::Time kLast = received(4294967295u, 950000000u);

class TimeJumpsTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { ros::Time::init(); }
  void TearDown() override { ros::Time::init(); }

  static void setClock(double now) { ros::Time::setNow(ros::Time(now)); }
  bool streamWentBack(double stamp) { return jumps_.streamWentBack(ros::Time(stamp)); }

  TimeJumps jumps_;
};

}  // namespace

TEST_F(TimeJumpsTest, AStreamMayGoBackByTheTolerance) {
  for (const double tolerance : {0.5, 3.0}) {
    TimeJumps jumps;
    jumps.setTolerance(tolerance);
    EXPECT_FALSE(jumps.streamWentBack(ros::Time(100)));
    EXPECT_FALSE(jumps.streamWentBack(ros::Time(100 - 0.9 * tolerance)));
    EXPECT_FALSE(jumps.streamWentBack(ros::Time(100)));
    EXPECT_TRUE(jumps.streamWentBack(ros::Time(100 - 1.1 * tolerance)));
    EXPECT_FALSE(jumps.streamWentBack(ros::Time(100 - 1.1 * tolerance)));
  }
}

TEST_F(TimeJumpsTest, TheClockTellsOnceWhoeverAsksFirst) {
  setClock(100);
  EXPECT_FALSE(jumps_.clockWentBack());
  EXPECT_FALSE(streamWentBack(100));
  setClock(99.95);
  EXPECT_FALSE(jumps_.clockWentBack()) << "NTP";
  setClock(10);
  EXPECT_TRUE(jumps_.clockWentBack());
  EXPECT_FALSE(streamWentBack(10)) << "the same jump";
  setClock(5);
  EXPECT_TRUE(streamWentBack(5));
  EXPECT_FALSE(jumps_.clockWentBack());
}

TEST_F(TimeJumpsTest, AClockThatFollowsTheStreamMakesNoSecondJump) {
  for (int i = 0; i < 3; ++i) {
    setClock(100);
    EXPECT_FALSE(streamWentBack(100));
    EXPECT_TRUE(streamWentBack(10));
    EXPECT_FALSE(streamWentBack(10.2));
    setClock(10);
    EXPECT_FALSE(jumps_.clockWentBack());
    EXPECT_FALSE(streamWentBack(10.4));
  }
}

TEST_F(TimeJumpsTest, AFrameOfBeforeTheJumpMakesNoSecondOne) {
  setClock(100);
  streamWentBack(100);
  setClock(10);
  EXPECT_TRUE(jumps_.clockWentBack());
  EXPECT_FALSE(streamWentBack(100.2));
  EXPECT_FALSE(streamWentBack(10.1));
}

TEST_F(TimeJumpsTest, NoStampThrows) {
  for (const ros::Time& stamp : {kLast, ros::Time(), received(4294967295u, 4294967295u), kLast})
    EXPECT_NO_THROW(jumps_.streamWentBack(stamp));
}

TEST(Stamps, DifferencesHaveNoLimits) {
  EXPECT_DOUBLE_EQ(secondsBetween(ros::Time(), kLast), 4294967295.95);
  EXPECT_DOUBLE_EQ(secondsBetween(kLast, ros::Time()), -4294967295.95);
  EXPECT_DOUBLE_EQ(secondsBetween(ros::Time(1.5), ros::Time(2.25)), 0.75);
}

TEST(Stamps, ImpossibleOnesAreRefused) {
  EXPECT_NO_THROW(requirePossible(ros::Time()));
  EXPECT_NO_THROW(requirePossible(ros::Time(1800000000.5)));
  EXPECT_THROW(requirePossible(kLast), std::invalid_argument);
  EXPECT_THROW(requirePossible(received(1, 4294967295u)), std::invalid_argument);
}
