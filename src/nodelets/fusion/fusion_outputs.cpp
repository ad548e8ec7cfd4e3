// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_outputs.hpp"

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>

#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/drawing.hpp"

namespace all_in_focus {

namespace enc = sensor_msgs::image_encodings;

namespace {

constexpr int kQueueSize = 10;          // images that a slow subscriber may lag behind without losing one
constexpr int kReportQueueSize = 1000;  // reports are small; those of brackets without images come in bursts

sensor_msgs::ImagePtr toImage(const std_msgs::Header& header, const std::string& encoding,
                              const cv::Mat& image) {
  OutgoingImage message(header, encoding, image.size());
  image.copyTo(message.mat);
  return message.take();
}

}  // namespace

// Published by plain ROS: image_transport publishes to present subscribers only, so later ones would get an
// older latched result, or none.
void FusionOutputs::advertise(ros::NodeHandle& nh, NodeStatus& status, const std::function<void()>& connect) {
  status_ = &status;
  const ros::SubscriberStatusCallback on_connect = [connect](const auto&) { connect(); };
  const auto advertise = [&](auto type, const char* topic, int queue_size = kQueueSize) {
    status.addOutput(topic);
    return nh.advertise<decltype(type)>(topic, queue_size, on_connect, on_connect, ros::VoidConstPtr(),
                                        /*latch=*/true);
  };
  image_ = advertise(sensor_msgs::Image(), "all_in_focus/image");
  weights_ = advertise(sensor_msgs::Image(), "all_in_focus/weights_color");
  depth_ = advertise(sensor_msgs::Image(), "all_in_focus/depth");
  depth_restored_ = advertise(sensor_msgs::Image(), "all_in_focus/depth_restored");
  source_index_ = advertise(sensor_msgs::Image(), "all_in_focus/source_index");
  confidence_ = advertise(sensor_msgs::Image(), "all_in_focus/confidence");
  info_ = advertise(sensor_msgs::CameraInfo(), "all_in_focus/camera_info");
  report_ = advertise(FusionReport(), "all_in_focus/report", kReportQueueSize);
}

bool FusionOutputs::wanted() const {
  const auto outputs = {&image_,        &weights_,    &depth_, &depth_restored_,
                        &source_index_, &confidence_, &info_,  &report_};
  return std::any_of(outputs.begin(), outputs.end(),
                     [](const ros::Publisher* output) { return output->getNumSubscribers() > 0; });
}

void FusionOutputs::publish(const FusedBracket& bracket) {
  const std_msgs::Header& header = bracket.report->header;
  const BracketResult& result = bracket.result;
  if (!result.image.empty()) {
    // The camera comes first: rviz's DepthCloud drops images that come before it.
    if (bracket.camera) {
      const auto restamped = boost::make_shared<sensor_msgs::CameraInfo>(*bracket.camera);
      restamped->header = header;
      info_.publish(restamped);
    }
    image_.publish(toImage(header, enc::BGR8, result.image));
    source_index_.publish(toImage(header, enc::TYPE_16UC1, result.source_index));
    confidence_.publish(toImage(header, enc::MONO8, result.confidence));
    cv::Mat weights;
    drawWeights(result.source_index, result.confidence, result.length, weights);
    cv::cvtColor(weights, weights, cv::COLOR_BGR2RGB);
    weights_.publish(toImage(header, enc::RGB8, weights));
    publishDepth(header, bracket.depth, result.image.size());
    if (!result.restored_depth.empty())
      depth_restored_.publish(toImage(header, enc::TYPE_16UC1, result.restored_depth));
  }
  report_.publish(bracket.report);
}

// rviz's DepthCloud wants depth of the colour image's stamp, frame and size.
void FusionOutputs::publishDepth(const std_msgs::Header& header, const sensor_msgs::ImageConstPtr& message,
                                 const cv::Size& size) {
  try {
    OutgoingImage out(header, enc::TYPE_16UC1, size);
    if (message) {
      core::resizeDepth(toDepth(message, {}, "depth_registered/image").mm, size, out.mat);
    } else {
      out.mat.setTo(0);  // unknown; the depth of an older result must not stay beside a newer picture
    }
    depth_.publish(out.take());
  } catch (const std::exception& e) {
    status_->error(e.what());
  }
}

}  // namespace all_in_focus
