// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/FocusPlan.h>
#include <all_in_focus/SegmenterConfig.h>
#include <image_transport/image_transport.h>
#include <sensor_msgs/image_encodings.h>
#include <visualization_msgs/MarkerArray.h>

#include <boost/make_shared.hpp>
#include <cstdint>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "all_in_focus/drawing.hpp"
#include "all_in_focus/focus_plan.hpp"
#include "all_in_focus/pipeline.hpp"
#include "conversions.hpp"
#include "image_limit.hpp"
#include "nodelet_of.hpp"
#include "parameters.hpp"
#include "topics.hpp"

namespace all_in_focus {
namespace {

using visualization_msgs::Marker;

constexpr double kTextHeight = 0.02;  // of the distance: equally legible near and far

core::Optics opticsOf(const SegmenterConfig& config) {
  return {config.focal_length_mm, config.aperture, config.circle_of_confusion_mm};
}

// The captions as text in space for rviz. Each lies on the ray of its anchor, at the near end of its region,
// because farther back the points of the region would hide it. header, camera: of the label image. labels:
// how many it has.
visualization_msgs::MarkerArray toMarkers(const std_msgs::Header& header, const Camera& camera, int labels,
                                          const std::vector<RegionCaption>& captions) {
  visualization_msgs::MarkerArray array;
  Marker marker;
  marker.header = header;
  marker.pose.orientation.w = 1;
  marker.action = Marker::DELETEALL;  // there may be fewer segments than in the last image
  array.markers.push_back(marker);

  marker.ns = "segments";
  marker.type = Marker::TEXT_VIEW_FACING;
  marker.action = Marker::ADD;
  const std::vector<cv::Vec3b> colors = labelColors(labels);
  // Pure blue is not legible.
  const auto pale = [](int value) { return static_cast<float>(2 * value + 255) / 765; };
  for (const RegionCaption& caption : captions) {
    const double z = caption.near_mm / kMmPerM;
    const cv::Point2d ray = camera.ray(caption.anchor);
    const cv::Vec3b& color = colors.at(caption.label);
    marker.id = caption.label;
    marker.text = caption.text;
    marker.pose.position.x = ray.x * z;
    marker.pose.position.y = ray.y * z;
    marker.pose.position.z = z;
    marker.scale.z = kTextHeight * z;
    marker.color.r = pale(color[2]);
    marker.color.g = pale(color[1]);
    marker.color.b = pale(color[0]);
    marker.color.a = 1;
    array.markers.push_back(marker);
  }
  return array;
}

}  // namespace

/// Cuts registered depth images into regions that fit into the depth of field.
///
/// All callbacks run one after the other.
class Segmenter {
 public:
  static constexpr const char* kProcessedTopic = "segmentation/processed";

  Segmenter(CallbackGuard& guard, NodeStatus& status)
      : guard_(guard),
        status_(status),
        depth_input_(status.addInput(topics::kDepth, Expect::kStream, "start depth_preprocess")),
        info_input_(status.addInput(topics::kDepthInfo, Expect::kOptional,
                                    "publish the calibration of the depth image's camera")) {
    readNumber(guard.slow.private_nh, "queue_size", 1, kMostWaiting, queue_size_, status);
    optics_publisher_ =
        guard.slow.nh.advertise<OpticsMsg>(status.addOutput(topics::kOptics), 1, /*latch=*/true);
    std::string mode = name(mode_);
    readParameter(guard.slow.private_nh, "mode", mode, status);
    repairName(mode, name(mode_), parseMode, status);
    mode_ = parseMode(mode);
    configuration_ = serveConfiguration<SegmenterConfig>(guard.slow.private_nh, guard, status,
                                                         [this](auto& config) { reconfigure(config); });
    advertise();
  }

 private:
  void advertise() {
    ros::NodeHandle& nh = guard_.slow.nh;
    image_transport::ImageTransport transport(nh);
    const auto on_connect = guard_.wrap([this](const auto& /*subscriber*/) { connect(); });

    labels_publisher_ =
        nh.advertise<sensor_msgs::Image>(status_.addOutput(topics::kLabels), 1, on_connect, on_connect);
    segments_publisher_ =
        nh.advertise<SegmentArray>(status_.addOutput("segmentation/segments"), 1, on_connect, on_connect);
    plan_publisher_ =
        nh.advertise<FocusPlan>(status_.addOutput("segmentation/focus_plan"), 1, on_connect, on_connect);
    picture_publisher_ =
        transport.advertise(status_.addOutput("segmentation/image_color"), 1, on_connect, on_connect);
    const auto on_listener = guard_.wrap([this](const auto& /*subscriber*/) {
      connect();
      publishMarkers();  // of the newest image
    });
    markers_publisher_ = nh.advertise<visualization_msgs::MarkerArray>(
        status_.addOutput("segmentation/markers"), 1, on_listener, on_connect);
  }

  void reconfigure(SegmenterConfig& config) {
    // No end of a range takes the place of a lens: depth would be cut and fused by a lens that nobody has.
    const auto check = [this](double& value, double good, const core::OpticsRange& range, const char* name) {
      repair(value, good, value >= range.min && value <= range.max, name,
             cv::format("from %g to %g", range.min, range.max), status_);
    };
    check(config.focal_length_mm, config_.focal_length_mm, core::kFocalLengthRange, "focal_length_mm");
    check(config.aperture, config_.aperture, core::kApertureRange, "aperture");
    check(config.circle_of_confusion_mm, config_.circle_of_confusion_mm, core::kCircleOfConfusionRange,
          "circle_of_confusion_mm");
    repairName(config.dof_rule, config_.dof_rule, core::parseDofSpan, status_);
    repairNumber(config.min_region_size, config_.min_region_size, 0, 100000, "min_region_size", status_);
    repairNumber(config.caption_min_area, config_.caption_min_area, 0.0, 100.0, "caption_min_area", status_);
    config_ = config;
    segmentation_.reset();
    optics_publisher_.publish(toMessage(opticsOf(config_)));
  }

  // Works only while anybody subscribes.
  void connect() {
    const bool wants_markers = anybodyListens(markers_publisher_);
    const bool wanted = wants_markers || anybodyListens(labels_publisher_, segments_publisher_,
                                                        plan_publisher_, picture_publisher_);
    // It is used for markers alone.
    status_.setExpect(info_input_, wants_markers ? Expect::kOnce : Expect::kOptional);
    if (wanted == status_.subscribed()) return;
    info_subscriber_ = {};
    depth_subscriber_ = {};
    camera_.reset();  // may be out of date when the next subscriber comes
    labels_.reset();  // out of date, too
    if (wanted) {
      info_subscriber_ = guard_.subscribe<sensor_msgs::CameraInfo>(
          guard_.slow, info_input_, [this](const auto& info) { onInfo(info); });
      depth_subscriber_ =
          guard_.subscribeToDepth(depth_input_, queue_size_, [this](const auto& depth) { onDepth(depth); });
    }
    status_.setSubscribed(wanted);
  }

  // It may come after the image, and again with each image.
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info) {
    const std::optional<Camera> before = std::exchange(camera_, std::nullopt);
    camera_ = toCamera(*info, "markers");
    if (!(camera_ == before)) publishMarkers();
  }

  void onDepth(const sensor_msgs::ImageConstPtr& message) {
    const cv::Mat depth = toDepth(*message, {}, status_.resolved(depth_input_));
    if (!segmentation_) {
      segmentation_ = std::make_unique<DofSegmentation>(segmentationConfig(
          mode_, opticsOf(config_), parseDofSpan(config_.dof_rule), config_.min_region_size));
    }
    labels_ =
        blankImage(message->header, sensor_msgs::image_encodings::TYPE_32SC1, depth.size(), result_.labels);
    segmentation_->compute(depth, result_);
    captions_.clear();

    // The labels come first: whatever fails or takes long afterwards, the fusion has them.
    const SegmentArrayPtr segments = toMessage(result_, segmentation_->config());
    segments->header = message->header;
    labels_publisher_.publish(labels_);
    segments_publisher_.publish(segments);
    try {
      publishPlan();
      publishCaptioned();
    } catch (const std::exception& e) {
      status_.error(std::string("labels are published, but not all that is drawn of them: ") + e.what());
    }

    const bool no_depth = result_.unknown_area == depth.rows * depth.cols;
    status_.acknowledge(message->header, Outcome::kProcessed,
                        no_depth ? status_.resolved(depth_input_) + ": not one pixel has a depth" : "");
  }

  void publishPlan() {
    if (!anybodyListens(plan_publisher_)) return;
    const core::Optics& optics = segmentation_->config().optics;
    const auto plan = boost::make_shared<FocusPlan>();
    plan->header = labels_->header;
    plan->optics = toMessage(optics);
    plan->segments = static_cast<std::uint32_t>(result_.segments.size());
    try {
      for (const PlannedFocus& one : planFocus(optics, result_.segments)) {
        plan->focus_distance.push_back(one.focus_mm / kMmPerM);
        plan->near_limit.push_back(one.near_mm / kMmPerM);
        plan->far_limit.push_back(one.far_mm / kMmPerM);
      }
      plan_publisher_.publish(plan);
    } catch (const std::invalid_argument& e) {
      status_.warn(e.what());  // the labels are right without a plan
    }
  }

  // Publishes the outputs with captions, which take longer than the labels.
  void publishCaptioned() {
    if (anybodyListens(picture_publisher_)) {
      captions_ = captionRegions(result_, config_.caption_min_area);
      cv::Mat regions;
      drawRegions(result_, captions_, regions);
      cv::cvtColor(regions, regions, cv::COLOR_BGR2RGB);
      picture_publisher_.publish(
          cv_bridge::CvImage(labels_->header, sensor_msgs::image_encodings::RGB8, regions).toImageMsg());
    }
    publishMarkers();
  }

  // Those of the result.
  void publishMarkers() {
    if (!camera_ || !labels_ || !anybodyListens(markers_publisher_)) return;
    requireSize(result_.labels, *camera_, status_.resolved(depth_input_), status_.resolved(info_input_));
    if (captions_.empty()) captions_ = captionRegions(result_, config_.caption_min_area);
    const auto labels = static_cast<int>(result_.segments.size());
    markers_publisher_.publish(toMarkers(labels_->header, *camera_, labels, captions_));
  }

  CallbackGuard& guard_;
  NodeStatus& status_;
  const int depth_input_, info_input_;
  int queue_size_ = 5;
  Mode mode_ = Mode::kRefined;
  SegmenterConfig config_ = SegmenterConfig::__getDefault__();  // always possible

  ros::Publisher labels_publisher_;  // no image_transport: lossy plug-ins would destroy labels
  ros::Publisher segments_publisher_, plan_publisher_, markers_publisher_;
  ros::Publisher optics_publisher_;  // latched, so that every bag contains the lens
  image_transport::Publisher picture_publisher_;

  std::unique_ptr<DofSegmentation> segmentation_;  // empty: the configuration has changed
  Segmentation result_;                            // of the newest depth image
  sensor_msgs::ImageConstPtr labels_;              // of the result, which draws in their memory; null: none
  std::vector<RegionCaption> captions_;            // of the result
  std::optional<Camera> camera_;                   // of the depth images

  image_transport::Subscriber depth_subscriber_;
  ros::Subscriber info_subscriber_;
  std::unique_ptr<dynamic_reconfigure::Server<SegmenterConfig>> configuration_;
};

using SegmenterNodelet = NodeletOf<Segmenter>;

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::SegmenterNodelet, nodelet::Nodelet)
