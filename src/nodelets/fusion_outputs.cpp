// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_outputs.hpp"

#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>

#include "all_in_focus/drawing.hpp"

namespace all_in_focus {

namespace enc = sensor_msgs::image_encodings;

namespace {

sensor_msgs::ImagePtr toImage(const std_msgs::Header& header, const std::string& encoding,
                              const cv::Mat& image) {
  OutgoingImage message(header, encoding, image.size());
  image.copyTo(message.mat);
  return message.take();
}

}  // namespace

void FusionOutputs::advertise(ros::NodeHandle& nh, image_transport::ImageTransport& transport,
                              NodeMonitor& monitor, const std::function<void()>& connect) {
  monitor_ = &monitor;
  const auto image = [&](LatchedImage& output, const char* topic) {
    const image_transport::SubscriberStatusCallback on_disconnect = [connect](const auto&) { connect(); };
    const image_transport::SubscriberStatusCallback on_connect = [this, connect,
                                                                  &output](const auto& subscriber) {
      connect();
      std::lock_guard<std::mutex> lock(mutex_);
      if (output.last) subscriber.publish(output.last);
    };
    monitor.addOutput(topic);
    output.publisher = transport.advertise(topic, 1, on_connect, on_disconnect);
  };
  const auto message = [&](auto type, const char* topic) {
    const ros::SubscriberStatusCallback on_connect = [connect](const auto&) { connect(); };
    monitor.addOutput(topic);
    return nh.advertise<decltype(type)>(topic, 1, on_connect, on_connect, ros::VoidConstPtr(),
                                        /*latch=*/true);
  };
  image(image_, "all_in_focus/image");
  image(weights_, "all_in_focus/weights_color");
  image(depth_, "all_in_focus/depth");
  source_index_ = message(sensor_msgs::Image(), "all_in_focus/source_index");
  info_ = message(sensor_msgs::CameraInfo(), "all_in_focus/camera_info");
  report_ = message(FusionReport(), "all_in_focus/report");
}

bool FusionOutputs::wanted() const {
  for (const LatchedImage* output : {&image_, &weights_, &depth_}) {
    if (output->publisher.getNumSubscribers() > 0) return true;
  }
  return source_index_.getNumSubscribers() + info_.getNumSubscribers() + report_.getNumSubscribers() > 0;
}

void FusionOutputs::setCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  std::lock_guard<std::mutex> lock(mutex_);
  camera_info_ = info;
}

void FusionOutputs::publish(const FusedBracket& bracket) {
  const std_msgs::Header& header = bracket.report->header;
  const FusionResult& result = bracket.result;
  if (!result.image.empty()) {
    publish(image_, toImage(header, enc::BGR8, result.image));
    source_index_.publish(toImage(header, enc::TYPE_16UC1, result.source_index));
    cv::Mat weights;
    drawWeights(result.source_index, result.confidence, bracket.frames, weights);
    cv::cvtColor(weights, weights, cv::COLOR_BGR2RGB);
    publish(weights_, toImage(header, enc::RGB8, weights));
    if (bracket.depth) publishDepth(header, bracket.depth, result.image.size());
    sensor_msgs::CameraInfoConstPtr info;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      info = camera_info_;
    }
    if (info) {
      const auto restamped = boost::make_shared<sensor_msgs::CameraInfo>(*info);
      restamped->header = header;
      info_.publish(restamped);
    }
  }
  report_.publish(bracket.report);
}

void FusionOutputs::publish(LatchedImage& output, const sensor_msgs::ImageConstPtr& message) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    output.last = message;
  }
  output.publisher.publish(message);
}

// rviz's DepthCloud wants depth of the colour image's stamp, frame and size.
void FusionOutputs::publishDepth(const std_msgs::Header& header, const sensor_msgs::ImageConstPtr& message,
                                 const cv::Size& size) {
  try {
    const DepthImage depth = toDepth(message, {}, "depth_registered/image");
    OutgoingImage out(header, enc::TYPE_16UC1, size);
    cv::resize(depth.mm, out.mat, size, 0, 0, cv::INTER_NEAREST);
    publish(depth_, out.take());
  } catch (const std::exception& e) {
    monitor_->error(e.what());
  }
}

}  // namespace all_in_focus
