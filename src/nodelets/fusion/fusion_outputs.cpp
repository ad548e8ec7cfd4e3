// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_outputs.hpp"

#include <all_in_focus/Progress.h>
#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/drawing.hpp"
#include "topics.hpp"

namespace all_in_focus {

using cv_bridge::CvImage;
namespace enc = sensor_msgs::image_encodings;

namespace {

constexpr int kQueueSize = 10;          // images that a slow subscriber may lag behind without losing one
constexpr int kReportQueueSize = 1000;  // reports are small; those of brackets without images come in bursts
constexpr int kProgressQueueSize = 64;  // frames, which are small, and now and then a result

}  // namespace

// Published by plain ROS: image_transport publishes to present subscribers only, so later ones would get an
// older latched result, or none.
FusionOutputs::FusionOutputs(ros::NodeHandle& nh, NodeStatus& status, const std::function<void()>& connect)
    : status_(status) {
  const ros::SubscriberStatusCallback on_connect = [connect](const auto&) { connect(); };
  const auto advertise = [&](auto type, const std::string& topic, int queue_size = kQueueSize) {
    return nh.advertise<decltype(type)>(topic, queue_size, on_connect, on_connect, ros::VoidConstPtr(),
                                        /*latch=*/true);
  };
  const sensor_msgs::Image image;
  image_ = advertise(image, status.addOutput("all_in_focus/image"));
  weights_ = advertise(image, status.addOutput("all_in_focus/weights_color"));
  depth_ = advertise(image, status.addOutput("all_in_focus/depth"));
  source_index_ = advertise(image, status.addOutput("all_in_focus/source_index"));
  confidence_ = advertise(image, status.addOutput("all_in_focus/confidence"));
  depth_restored_ = advertise(image, status.addOutput("all_in_focus/depth_restored"));
  info_ = advertise(sensor_msgs::CameraInfo(), status.addOutput("all_in_focus/camera_info"));
  report_ = advertise(FusionReport(), status.addOutput("all_in_focus/report"), kReportQueueSize);
  // Not latched: of what is latched nobody knows whether it is new.
  progress_ = nh.advertise<Progress>(status.addOutput("all_in_focus/progress"), kProgressQueueSize,
                                     on_connect, on_connect);
  const auto on_listener = [this, connect](const ros::SingleSubscriberPublisher& listener) {
    connect();
    if (const auto cloud = latestPoints()) listener.publish(*cloud);
  };
  points_ =
      nh.advertise<sensor_msgs::PointCloud2>(status.addOutput(topics::kPoints), 1, on_listener, on_connect);
}

bool FusionOutputs::wanted() const {
  return anybodyListens(image_, weights_, depth_, depth_restored_, source_index_, confidence_, info_, points_,
                        report_, progress_);
}

void FusionOutputs::tell(const FocusFrame& frame) {
  Progress progress;
  progress.frame = frame;
  progress_.publish(progress);
}

void FusionOutputs::publish(const BracketResult& result, const FusionReportPtr& report,
                            const SharedScene& scene) {
  const std_msgs::Header& header = report->header;
  const sensor_msgs::CameraInfoConstPtr& camera = scene.messages.camera;
  const auto progress = boost::make_shared<Progress>();
  if (!result.image.empty()) {
    // The camera comes first: rviz's DepthCloud drops images that come before it.
    if (camera) {
      const auto restamped = boost::make_shared<sensor_msgs::CameraInfo>(*camera);
      restamped->header = header;
      info_.publish(restamped);
    }
    const bool is_deep = result.image.depth() == CV_16U;
    const sensor_msgs::ImagePtr image =
        CvImage(header, is_deep ? enc::BGR16 : enc::BGR8, result.image).toImageMsg();
    image_.publish(image);
    source_index_.publish(CvImage(header, enc::TYPE_16UC1, result.source_index).toImageMsg());
    confidence_.publish(CvImage(header, enc::MONO8, result.confidence).toImageMsg());
    cv::Mat drawn, weights;
    drawWeights(result.source_index, result.confidence, result.length, drawn);
    const sensor_msgs::ImagePtr weights_message = blankImage(header, enc::RGB8, drawn.size(), weights);
    cv::cvtColor(drawn, weights, cv::COLOR_BGR2RGB);
    weights_.publish(weights_message);
    // All 0 where depth is unknown: that of an older result must not stay beside a newer picture. rviz's
    // DepthCloud wants depth of the colour image's stamp, frame and size.
    cv::Mat mm;
    sensor_msgs::ImagePtr depth = blankImage(header, enc::TYPE_16UC1, result.image.size(), mm);
    if (!scene.scene.depth.empty()) core::resizeDepth(scene.scene.depth, result.image.size(), mm);
    depth_.publish(depth);
    if (!result.restored_depth.empty()) {
      depth = CvImage(header, enc::TYPE_16UC1, result.restored_depth).toImageMsg();
      depth_restored_.publish(depth);
    }
    {
      std::lock_guard<std::mutex> lock(mutex_);
      latest_ = {image, depth, camera};
    }
    const auto cloud = anybodyListens(points_) ? latestPoints() : nullptr;
    if (cloud) points_.publish(cloud);
    if (anybodyListens(progress_)) {
      progress->image = *image;
      progress->depth = *depth;
      if (cloud) progress->points = *cloud;
    }
  }
  report_.publish(report);
  progress->is_result = 1;
  progress->report = *report;
  progress_.publish(progress);
}

// Null where there is no result yet, or no calibration.
sensor_msgs::PointCloud2ConstPtr FusionOutputs::latestPoints() const {
  Latest latest;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    latest = latest_;
  }
  if (!latest.image || !latest.camera) return nullptr;
  try {
    const cv::Mat mm = cv_bridge::toCvShare(latest.depth)->image;
    if (cv::countNonZero(mm) == 0) return nullptr;
    const core::Camera camera = toCamera(*latest.camera, topics::kColorInfo);
    const cv::Mat bgr = core::toEightBits(cv_bridge::toCvShare(latest.image)->image);
    return toPointCloud(latest.image->header, bgr, mm, camera);
  } catch (const std::exception& e) {
    status_.error(std::string(topics::kPoints) + ": " + e.what());
    return nullptr;
  }
}

}  // namespace all_in_focus
