// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// What waits for its turn in a node that cannot keep up.

#include <gtest/gtest.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <boost/make_shared.hpp>
#include <cstdint>
#include <vector>

#include "callback_guard.hpp"
#include "node_status.hpp"

using namespace all_in_focus;

TEST(CallbackGuard, AnImageThatTakesThePlaceOfADroppedOneHasNoCallOfItsOwn) {
  constexpr std::uint32_t kSent = 50, kMost = 3;  // roscpp itself holds 64
  const ros::WallDuration patience(30);
  ros::NodeHandle nh, private_nh("~");
  NodeStatus status("guard", nh, private_nh, "processed");
  CallbackGuard guard(nh, private_nh, status);
  std::vector<std::uint32_t> processed;
  const auto process = [&](const auto& image) { processed.push_back(image->header.stamp.sec); };
  const auto subscriber =
      guard.subscribeToDepth(status.addInput("depth", Expect::kStream, ""), kMost, process);
  const ros::Publisher publisher = nh.advertise<sensor_msgs::Image>("depth", kSent);
  const ros::WallTime end = ros::WallTime::now() + patience;
  while (publisher.getNumSubscribers() == 0 && ros::WallTime::now() < end) ros::WallDuration(0.01).sleep();
  for (std::uint32_t number = 1; number <= kSent; ++number) {
    const auto image = boost::make_shared<sensor_msgs::Image>();
    image->header.stamp.sec = number;
    publisher.publish(image);
  }

  // Its threads are not started: all images arrive before the first one has its turn.
  for (std::uint32_t number = 1; number <= kSent; ++number)
    ASSERT_EQ(guard.quick.queue.callOne(patience), ros::CallbackQueue::Called) << number;
  std::uint32_t calls = 0;
  while (guard.slow.queue.callOne() == ros::CallbackQueue::Called) ++calls;
  EXPECT_EQ(calls, kMost);
  EXPECT_EQ(processed, (std::vector<std::uint32_t>{kSent - 2, kSent - 1, kSent}));
}

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "callback_guard");
  return RUN_ALL_TESTS();
}
