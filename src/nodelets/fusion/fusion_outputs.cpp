// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_outputs.hpp"

#include <all_in_focus/Progress.h>
#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/algorithm/string/join.hpp>
#include <boost/make_shared.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/drawing.hpp"
#include "topics.hpp"

namespace all_in_focus {

namespace enc = sensor_msgs::image_encodings;

namespace {

constexpr int kQueueSize = 10;          // images that a slow subscriber may lag behind without losing one
constexpr int kReportQueueSize = 1000;  // reports are small; those of brackets without images come in bursts
constexpr int kProgressQueueSize = 64;  // frames, which are small, and now and then a result

}  // namespace

// Depth of the picture's size, mm; all 0 where it is unknown: the depth of an older result must not stay
// beside a newer picture. rviz's DepthCloud wants depth of the colour image's stamp, frame and size.
cv::Mat FusionOutputs::depthOf(const FusedBracket& bracket) const {
  const cv::Size size = bracket.result.image.size();
  if (bracket.depth.empty()) return cv::Mat::zeros(size, CV_16UC1);
  cv::Mat mm;
  core::resizeDepth(bracket.depth, size, mm);
  return mm;
}

// Published by plain ROS: image_transport publishes to present subscribers only, so later ones would get an
// older latched result, or none.
FusionOutputs::FusionOutputs(ros::NodeHandle& nh, NodeStatus& status, const std::function<void()>& connect)
    : status_(status) {
  const ros::SubscriberStatusCallback on_connect = [connect](const auto&) { connect(); };
  const auto advertise = [nh, on_connect](auto type, const std::string& topic, int queue_size = kQueueSize) {
    return ros::NodeHandle(nh).advertise<decltype(type)>(topic, queue_size, on_connect, on_connect,
                                                         ros::VoidConstPtr(), /*latch=*/true);
  };
  const sensor_msgs::Image image;
  image_ = advertise(image, status.addOutput("all_in_focus/image"));
  weights_ = advertise(image, status.addOutput("all_in_focus/weights_color"));
  depth_ = advertise(image, status.addOutput("all_in_focus/depth"));
  source_index_ = advertise(image, status.addOutput("all_in_focus/source_index"));
  confidence_ = advertise(image, status.addOutput("all_in_focus/confidence"));
  const std::string restored = status.addOutput("all_in_focus/depth_restored");
  advertise_restored_ = [advertise, image, restored] { return advertise(image, restored); };
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

void FusionOutputs::setMode(Mode mode) {
  std::lock_guard<std::mutex> lock(mutex_);
  const bool restores = mode == Mode::kRestored;
  if (restores != static_cast<bool>(depth_restored_))
    depth_restored_ = restores ? advertise_restored_() : ros::Publisher();
}

ros::Publisher FusionOutputs::restoredOutput() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return depth_restored_;
}

// A listener that gets nothing is told why. mm: depthOf(bracket), empty without a picture.
std::string FusionOutputs::askedInVain(const FusedBracket& bracket, const cv::Mat& mm) const {
  std::vector<std::string> lines;
  const bool restored = !bracket.result.restored_depth.empty();
  const auto check = [&lines](const ros::Publisher& output, const std::string& missing) {
    if (anybodyListens(output)) lines.push_back(output.getTopic() + ": " + missing);
  };
  if (!restored) check(restoredOutput(), "only a bracket that is restored by focus distances has it");
  if (!bracket.camera) check(points_, std::string("no calibration on ") + topics::kColorInfo);
  if (!restored && (mm.empty() || cv::countNonZero(mm) == 0)) {
    if (bracket.camera) check(points_, "no depth is known");
    check(depth_, "no depth is known, all 0");
  }
  return lines.empty() ? "nothing" : boost::algorithm::join(lines, "; ");
}

bool FusionOutputs::wanted() const {
  return anybodyListens(image_, weights_, depth_, restoredOutput(), source_index_, confidence_, info_,
                        points_, report_, progress_);
}

void FusionOutputs::tell(const FocusFrame& frame) {
  Progress progress;
  progress.frame = frame;
  progress_.publish(progress);
}

void FusionOutputs::publish(const FusedBracket& bracket) {
  const std_msgs::Header& header = bracket.report->header;
  const BracketResult& result = bracket.result;
  const auto progress = boost::make_shared<Progress>();
  const bool has_progress = anybodyListens(progress_);
  cv::Mat mm;
  if (!result.image.empty()) {
    // The camera comes first: rviz's DepthCloud drops images that come before it.
    if (bracket.camera) {
      const auto restamped = boost::make_shared<sensor_msgs::CameraInfo>(*bracket.camera);
      restamped->header = header;
      info_.publish(restamped);
    }
    const bool is_deep = result.image.depth() == CV_16U;
    const sensor_msgs::ImagePtr image = toImage(header, is_deep ? enc::BGR16 : enc::BGR8, result.image);
    image_.publish(image);
    source_index_.publish(toImage(header, enc::TYPE_16UC1, result.source_index));
    confidence_.publish(toImage(header, enc::MONO8, result.confidence));
    cv::Mat weights;
    drawWeights(result.source_index, result.confidence, result.length, weights);
    cv::cvtColor(weights, weights, cv::COLOR_BGR2RGB);
    weights_.publish(toImage(header, enc::RGB8, weights));
    mm = depthOf(bracket);
    sensor_msgs::ImagePtr depth = toImage(header, enc::TYPE_16UC1, mm);
    depth_.publish(depth);
    if (!result.restored_depth.empty()) {
      depth = toImage(header, enc::TYPE_16UC1, result.restored_depth);
      if (const ros::Publisher output = restoredOutput()) output.publish(depth);
    }
    {
      std::lock_guard<std::mutex> lock(mutex_);
      latest_ = {image, depth, bracket.camera};
    }
    if (const auto cloud = anybodyListens(points_) ? latestPoints() : nullptr) {
      points_.publish(cloud);
      if (has_progress) progress->points = *cloud;
    }
    if (has_progress) {
      progress->image = *image;
      progress->depth = *depth;
    }
  }
  status_.setValue("asked for in vain", askedInVain(bracket, mm));
  report_.publish(bracket.report);
  progress->is_result = 1;
  progress->report = *bracket.report;
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
