// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The three nodelets in this process: images go from one to the next as pointers.

#include <gtest/gtest.h>
#include <nodelet/loader.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <array>
#include <atomic>
#include <boost/make_shared.hpp>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <list>
#include <map>
#include <string>
#include <vector>

namespace {

std::array<std::atomic<int>, 1 << 16> arrays_of_size;  // how often new uint8_t[size] was called

}  // namespace

// roscpp serialises into such arrays, whose size tells the message.
void* operator new[](std::size_t size) {
  if (size < arrays_of_size.size()) ++arrays_of_size[size];
  return operator new(size);
}
void operator delete[](void* memory) noexcept {
  operator delete(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  operator delete(memory);
}

namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr unsigned kWidth = 64, kHeight = 48;
const ros::Time kStamp(1000);

template <typename Message>
boost::shared_ptr<Message> stamped(const std::string& frame) {
  auto message = boost::make_shared<Message>();
  message->header.stamp = kStamp;
  message->header.frame_id = frame;
  message->width = kWidth;
  message->height = kHeight;
  return message;
}

sensor_msgs::ImagePtr image(const std::string& frame, const std::string& encoding, unsigned pixel_bytes) {
  const sensor_msgs::ImagePtr message = stamped<sensor_msgs::Image>(frame);
  message->encoding = encoding;
  message->step = kWidth * pixel_bytes;
  message->data.assign(message->step * kHeight, 5);
  return message;
}

sensor_msgs::CameraInfoPtr cameraInfo(const std::string& frame) {
  const sensor_msgs::CameraInfoPtr info = stamped<sensor_msgs::CameraInfo>(frame);
  info->K = {50, 0, kWidth / 2.0, 0, 50, kHeight / 2.0, 0, 0, 1};
  return info;
}

bool waitFor(const std::function<bool()>& condition) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(30);
  while (!condition() && ros::WallTime::now() < end) {
    ros::spinOnce();
    ros::WallDuration(0.01).sleep();
  }
  return condition();
}

/// The last image of a topic.
struct Listener {
  explicit Listener(const std::string& topic)
      : subscriber(ros::NodeHandle().subscribe<sensor_msgs::Image>(
            topic, 1, [this](const sensor_msgs::ImageConstPtr& message) { last = message; })) {}
  const void* pixels() const { return last ? last->data.data() : nullptr; }
  int timesSerialised() const {
    return arrays_of_size[ros::serialization::serializationLength(*last) + sizeof(std::uint32_t)];
  }

  sensor_msgs::ImageConstPtr last;
  ros::Subscriber subscriber;
};

/// How the messages of each topic travel from and to this process.
std::multimap<std::string, std::string> transportsByTopic() {
  std::string host;
  std::uint32_t port = 0;
  ros::network::splitURI(ros::XMLRPCManager::instance()->getServerURI(), host, port);
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port));
  XmlRpc::XmlRpcValue caller, answer;
  caller[0] = ros::this_node::getName();
  EXPECT_TRUE(client.execute("getBusInfo", caller, answer));
  XmlRpc::XmlRpcValue& links = answer[2];
  std::multimap<std::string, std::string> transports;
  for (int i = 0; i < links.size(); ++i) {
    transports.emplace(std::string(links[i][4]), std::string(links[i][3]));
  }
  return transports;
}

}  // namespace

TEST(ZeroCopy, ImagesTravelAsPointers) {
  tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped transform;
  transform.header.frame_id = "color";
  transform.child_frame_id = "depth";
  transform.transform.rotation.w = 1;
  broadcaster.sendTransform(transform);

  // Before anybody subscribes: roscpp connects twice where both happen at the same time.
  ros::NodeHandle nh;
  const auto depth_info_publisher = nh.advertise<sensor_msgs::CameraInfo>("depth/camera_info", 1, true);
  const auto rgb_info_publisher = nh.advertise<sensor_msgs::CameraInfo>("rgb/camera_info", 1, true);
  const auto depth_publisher = nh.advertise<sensor_msgs::Image>("depth/image_raw", 1);
  const auto rgb_publisher = nh.advertise<sensor_msgs::Image>("rgb/image", 1);

  nodelet::Loader loader;
  for (const char* name : {"depth_preprocess", "segmenter", "fusion"}) {
    ASSERT_TRUE(loader.load(std::string("/") + name, std::string("all_in_focus/") + name, {}, {})) << name;
  }
  const std::vector<std::string> topics = {"/depth/image_raw", "/depth_registered/image",
                                           "/segmentation/labels"};
  std::list<Listener> first, second;
  for (const std::string& topic : topics) {
    first.emplace_back(topic);
    second.emplace_back(topic);
  }
  std::list<Listener> others;
  Listener& unfilled = others.emplace_back("/depth_registered/image_raw");
  Listener& fused = others.emplace_back("/all_in_focus/image");

  depth_info_publisher.publish(cameraInfo("depth"));
  rgb_info_publisher.publish(cameraInfo("color"));
  for (const std::string& topic : {nh.resolveName("depth/image_raw"), nh.resolveName("rgb/image")}) {
    ASSERT_TRUE(waitFor([&] { return transportsByTopic().count(topic) == 2; }))
        << "nobody listens to " << topic;
  }
  const sensor_msgs::ImagePtr depth = image("depth", enc::TYPE_16UC1, 2);
  depth_publisher.publish(depth);
  // The fusion's results are latched, so serialised: another frame_id makes their size another one.
  rgb_publisher.publish(image("color_of_results", enc::BGR8, 3));
  ASSERT_TRUE(waitFor([&] { return fused.last && unfilled.last; })) << "nothing fused";

  for (auto a = first.begin(), b = second.begin(); a != first.end(); ++a, ++b) {
    const std::string topic = a->subscriber.getTopic();
    ASSERT_TRUE(waitFor([&] { return a->last && b->last; })) << topic;
    EXPECT_EQ(a->pixels(), b->pixels()) << topic;
    EXPECT_EQ(a->timesSerialised(), 0) << topic;
  }
  // What arrives is the very object that was published, on one topic or on two.
  EXPECT_EQ(first.front().pixels(), depth->data.data());
  EXPECT_EQ(unfilled.pixels(), std::next(first.begin())->pixels());

  const auto transports = transportsByTopic();
  for (const std::string& topic : topics) EXPECT_EQ(transports.count(topic), 2u) << topic;  // out and in
  for (const auto& [topic, transport] : transports) {
    if (topic != "/rosout") {
      EXPECT_EQ(transport, "INTRAPROCESS") << topic;
    }
  }

  // A nodelet that is unloaded while one of its callbacks runs outlives its callback queues, and crashes
  // (nodelet_core). So the nodelets become idle first.
  first.clear();
  second.clear();
  others.clear();
  EXPECT_TRUE(waitFor([&] {
    return depth_publisher.getNumSubscribers() == 0 && rgb_publisher.getNumSubscribers() == 0;
  })) << "somebody still listens";
  ros::WallDuration(0.5).sleep();
}

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "zero_copy");
  const ros::NodeHandle keep_running;
  return RUN_ALL_TESTS();
}
