// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "kinect_clock.hpp"

namespace all_in_focus {
namespace {

constexpr std::uint64_t kPeriod = 33333;  // us
const ros::Time kStart(1000, 0);

double secondsAfterStart(const ros::Time& time) {
  return (time - kStart).toSec();
}

TEST(KinectClock, StampsJitterLessThanArrivals) {
  std::mt19937 random(1);
  std::exponential_distribution<double> late(1 / 0.005);  // mean 5 ms
  KinectClock clock;
  double last_arrival = 0, last_stamp = 0, arrivals = 0, stamps = 0;  // squared errors of the steps
  for (int i = 0; i < 600; ++i) {
    const double arrival = 0.010 + i * kPeriod * 1e-6 + late(random);
    const double stamp =
        secondsAfterStart(clock.stamp(7000000 + i * kPeriod, kStart + ros::Duration(arrival)));
    EXPECT_LE(stamp, arrival + 1e-9);
    EXPECT_LT(arrival - stamp, 0.1);
    if (i > 60) {
      arrivals += std::pow(arrival - last_arrival - kPeriod * 1e-6, 2);
      stamps += std::pow(stamp - last_stamp - kPeriod * 1e-6, 2);
    }
    last_arrival = arrival;
    last_stamp = stamp;
  }
  EXPECT_LT(std::sqrt(stamps), 0.25 * std::sqrt(arrivals));
}

TEST(KinectClock, DriftIsFollowed) {
  KinectClock clock;
  for (int i = 0; i < 30000; ++i) {  // a quarter of an hour, 100 ppm
    const double arrival = i * kPeriod * 1.0001e-6;
    const double stamp = secondsAfterStart(clock.stamp(i * kPeriod, kStart + ros::Duration(arrival)));
    ASSERT_NEAR(stamp, arrival, 0.001) << i;
  }
}

TEST(KinectClock, OneVeryLateImageMovesNoOther) {
  KinectClock clock;
  for (int i = 0; i < 100; ++i) {
    const double due = i * kPeriod * 1e-6;
    const double stamp =
        secondsAfterStart(clock.stamp(i * kPeriod, kStart + ros::Duration(due + (i == 50 ? 0.5 : 0))));
    EXPECT_NEAR(stamp, due, 1e-4) << i;
  }
}

TEST(KinectClock, OneSecondOfLateImagesMovesNoOther) {
  KinectClock clock;
  for (int i = 0; i < 150; ++i) {
    const double due = i * kPeriod * 1e-6;
    const bool is_busy = i >= 60 && i < 90;
    const double stamp =
        secondsAfterStart(clock.stamp(i * kPeriod, kStart + ros::Duration(due + (is_busy ? 0.03 : 0))));
    EXPECT_NEAR(stamp, due, 1e-4) << i;
  }
}

TEST(KinectClock, StartsAfreshWhenEitherClockJumps) {
  KinectClock clock;
  ros::Time last;
  const std::uint64_t device[] = {5000000, 5033333, 100, 33433, 90000000, 90033333};  // back, and 90 s ahead
  for (int i = 0; i < 6; ++i) {
    const ros::Time arrival = kStart + ros::Duration(i / 30.0);
    const ros::Time stamp = clock.stamp(device[i], arrival);
    EXPECT_NEAR((arrival - stamp).toSec(), 0, 0.001) << i;
    EXPECT_GT(stamp, last);
    last = stamp;
  }
  const ros::Time set_back = kStart - ros::Duration(900);
  EXPECT_NEAR((clock.stamp(90066666, set_back) - set_back).toSec(), 0, 1e-6);
}

TEST(KinectClock, StampsNeverRepeat) {
  KinectClock clock;
  const ros::Time first = clock.stamp(1000, kStart);
  EXPECT_GT(clock.stamp(1000, kStart), first);
}

TEST(KinectClock, PaceOfARecording) {
  KinectClock half(0.5), none(0);
  for (int i = 0; i < 60; ++i) {
    const double arrival = 2 * i * kPeriod * 1e-6;
    const double jitter = i % 5 ? 0.0 : 0.01;
    const double stamp = secondsAfterStart(half.stamp(i * kPeriod, kStart + ros::Duration(arrival + jitter)));
    if (i > 10) {
      EXPECT_NEAR(stamp, arrival, 0.001) << i;
    }
    EXPECT_EQ(none.stamp(i, kStart + ros::Duration(arrival)), kStart + ros::Duration(arrival));
  }
}

}  // namespace
}  // namespace all_in_focus
