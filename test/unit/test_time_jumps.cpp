// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cstdint>
#include <stdexcept>

#include "time_jumps.hpp"

using namespace all_in_focus;

namespace {

constexpr int kImage = 0, kLabels = 1;

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

  bool jumped(int input, double stamp) { return jumps_.arrived(input, ros::Time(stamp)).jumped; }
  bool leftover(int input, double stamp) { return jumps_.arrived(input, ros::Time(stamp)).leftover; }

  int reported_ = 0;
  TimeJumps jumps_{[this](int) { ++reported_; }};
};

}  // namespace

TEST_F(TimeJumpsTest, CountsAJumpOnceHoweverManyInputsShowIt) {
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(jumped(kImage, 100 + i));
    EXPECT_FALSE(jumped(kLabels, 100 + i));
  }
  EXPECT_TRUE(jumped(kLabels, 10));
  EXPECT_FALSE(jumped(kImage, 10));
  EXPECT_EQ(reported_, 1);
}

TEST_F(TimeJumpsTest, JitterIsNoJump) {
  jumped(kImage, 100);
  EXPECT_FALSE(jumped(kImage, 99.95));
  EXPECT_TRUE(jumped(kImage, 99.8));
}

TEST_F(TimeJumpsTest, WhatWasSentBeforeTheJumpIsALeftover) {
  jumped(kImage, 100);
  jumped(kLabels, 100);
  EXPECT_TRUE(jumped(kImage, 10));
  EXPECT_TRUE(leftover(kLabels, 100.5));
  EXPECT_FALSE(jumped(kLabels, 10));  // and does not make a second jump of the same
  EXPECT_FALSE(leftover(kLabels, 10.5));
  EXPECT_FALSE(leftover(kLabels, 100.2));  // time may go on to there
  EXPECT_EQ(reported_, 1);
}

TEST_F(TimeJumpsTest, AfterAShortJumpNothingIsALeftover) {
  jumped(kImage, 100);
  jumped(kLabels, 100);
  EXPECT_TRUE(jumped(kImage, 99.5));
  EXPECT_FALSE(leftover(kLabels, 100.1));
  EXPECT_TRUE(jumps_.arrived(kImage, ros::Time(99.6)).unclear);
  EXPECT_FALSE(jumps_.arrived(kImage, ros::Time(10)).unclear) << "a long jump";
}

TEST_F(TimeJumpsTest, NoStampThrows) {
  for (const ros::Time& stamp : {kLast, ros::Time(), received(4294967295u, 4294967295u), kLast}) {
    EXPECT_NO_THROW(jumps_.arrived(kImage, stamp));
    EXPECT_NO_THROW(jumps_.arrived(kLabels, stamp));
  }
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
