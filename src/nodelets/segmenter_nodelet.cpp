// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/SegmenterConfig.h>
#include <image_transport/image_transport.h>
#include <sensor_msgs/image_encodings.h>

#include <memory>
#include <opencv2/imgproc.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>

#include "all_in_focus/drawing.hpp"
#include "all_in_focus/focus_plan.hpp"
#include "all_in_focus/pipeline.hpp"
#include "configured_nodelet.hpp"
#include "conversions.hpp"
#include "image_queue.hpp"
#include "segment_markers.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

constexpr const char* kProcessedTopic = "segmentation/processed";

core::Optics opticsOf(const SegmenterConfig& config) {
  return {config.focal_length_mm, config.aperture, config.circle_of_confusion_mm};
}

}  // namespace

/// Cuts registered depth images into regions that fit into the depth of field.
///
/// All callbacks run one after the other.
class SegmenterNodelet : public ConfiguredNodelet<SegmenterConfig> {
 public:
  ~SegmenterNodelet() override;

 private:
  void onInit() override;
  void readMode();
  void advertise();
  void reconfigure(Config& config) override;
  void connect() override;
  void onDepth(const sensor_msgs::ImageConstPtr& depth);
  void process(const sensor_msgs::ImageConstPtr& depth);
  void publishPlan(const std_msgs::Header& header);
  void publishCaptioned(const std_msgs::Header& header);
  void publishPicture(const CaptionSet& captions);

  TimeJumps time_jumps_{[this](int input) { monitor_->timeWentBack(input); }};
  int depth_input_ = 0;
  Mode mode_ = Mode::kRefined;

  ros::Publisher labels_publisher_;  // no image_transport: lossy plug-ins would destroy labels
  ros::Publisher segments_publisher_, plan_publisher_;
  ros::Publisher optics_publisher_;  // latched, so that every bag contains the lens
  image_transport::Publisher picture_publisher_;
  std::unique_ptr<SegmentMarkers> markers_;

  std::unique_ptr<DofSegmentation> segmentation_;  // empty: the configuration has changed
  Segmentation result_;

  std::unique_ptr<ImageQueue> depth_queue_;
};

SegmenterNodelet::~SegmenterNodelet() {
  if (guard_) guard_->stop();
}

void SegmenterNodelet::onInit() {
  begin(kProcessedTopic);
  depth_input_ = monitor_->addInput("depth_registered/image", Expect::kStream, "start depth_preprocess");
  markers_ = std::make_unique<SegmentMarkers>(guard_->nh, *monitor_, *guard_);
  optics_publisher_ = guard_->nh.advertise<OpticsMsg>("rgb/optics", 1, true);
  readMode();
  takeConfiguration();
  depth_queue_ =
      std::make_unique<ImageQueue>(queue_size_, *monitor_, *guard_, depth_input_,
                                   [this](const sensor_msgs::ImageConstPtr& depth) { onDepth(depth); });
  advertise();
  guard_->start();
}

void SegmenterNodelet::readMode() {
  try {
    mode_ = parseMode(getPrivateNodeHandle().param("mode", std::string(name(mode_))));
  } catch (const std::invalid_argument& e) {
    monitor_->error(std::string(e.what()) + "; using " + name(mode_));
  }
  monitor_->setValue("mode", name(mode_));
}

void SegmenterNodelet::advertise() {
  ros::NodeHandle& nh = guard_->nh;
  image_transport::ImageTransport transport(nh);
  const auto on_connect = guard_->wrap(getName(), [this](const auto& /*subscriber*/) { connect(); });

  labels_publisher_ = nh.advertise<sensor_msgs::Image>("segmentation/labels", 1, on_connect, on_connect);
  segments_publisher_ = nh.advertise<SegmentArray>("segmentation/segments", 1, on_connect, on_connect);
  plan_publisher_ = nh.advertise<FocusPlan>("segmentation/focus_plan", 1, on_connect, on_connect);
  picture_publisher_ = transport.advertise("segmentation/image_color", 1, on_connect, on_connect);
  markers_->advertise(on_connect);
  for (const char* topic : {"segmentation/labels", "segmentation/segments", "segmentation/focus_plan",
                            "segmentation/image_color", "rgb/optics"}) {
    monitor_->addOutput(topic);
  }
}

void SegmenterNodelet::reconfigure(Config& config) {
  ConfigRepair repair;
  const auto check = [&repair](double& value, double good, const core::OpticsRange& range, const char* name) {
    repair.check(value, good, range.contains(value), name);
  };
  check(config.focal_length_mm, config_.focal_length_mm, core::kFocalLengthRange, "focal_length_mm");
  check(config.aperture, config_.aperture, core::kApertureRange, "aperture");
  check(config.circle_of_confusion_mm, config_.circle_of_confusion_mm, core::kCircleOfConfusionRange,
        "circle_of_confusion_mm");
  repair.checkOneOf(config.dof_rule, config_.dof_rule, {"paper", "full"}, "dof_rule");
  repair.checkNotNegative(config.min_region_size, config_.min_region_size, "min_region_size");
  repair.checkNotNegative(config.caption_min_area, config_.caption_min_area, "caption_min_area");
  if (!repair.warnings().empty()) monitor_->warn(repair.warnings());
  config_ = config;
  segmentation_.reset();
  optics_publisher_.publish(toMessage(opticsOf(config_)));

  monitor_->setValue("optics", cv::format("f %g mm, F %g, circle of confusion %g mm", config.focal_length_mm,
                                          config.aperture, config.circle_of_confusion_mm));
  monitor_->setValue("dof_rule", config.dof_rule);
}

// Works only while anybody subscribes.
void SegmenterNodelet::connect() {
  const bool wanted = labels_publisher_.getNumSubscribers() > 0 ||
                      segments_publisher_.getNumSubscribers() > 0 ||
                      plan_publisher_.getNumSubscribers() > 0 || picture_publisher_.getNumSubscribers() > 0 ||
                      markers_->wanted();
  markers_->listen(wanted);
  if (wanted && !*depth_queue_) {
    depth_queue_->subscribe("depth_registered/image");
    monitor_->setSubscribed(true);
  } else if (!wanted && *depth_queue_) {
    depth_queue_->shutdown();
    monitor_->setSubscribed(false);
  }
}

void SegmenterNodelet::onDepth(const sensor_msgs::ImageConstPtr& depth) {
  time_jumps_.arrived(depth_input_, depth->header.stamp);  // reports time jumps; there is no cache to empty
  try {
    process(depth);
  } catch (const std::exception& e) {
    monitor_->acknowledge(depth->header, Outcome::kInvalid, e.what());
  }
}

void SegmenterNodelet::process(const sensor_msgs::ImageConstPtr& message) {
  const DepthImage depth = toDepth(message, {}, monitor_->resolved(depth_input_));
  if (!segmentation_) {
    segmentation_ = std::make_unique<DofSegmentation>(segmentationConfig(
        mode_, opticsOf(config_), parseDofSpan(config_.dof_rule), config_.min_region_size));
  }
  OutgoingImage labels(message->header, sensor_msgs::image_encodings::TYPE_32SC1, depth.mm.size());
  result_.labels = labels.mat;
  segmentation_->compute(depth.mm, result_);
  labels.mat = result_.labels;

  publishCaptioned(message->header);
  publishPlan(message->header);
  result_.labels.release();  // their memory belongs to the message
  const SegmentArrayPtr segments = toMessage(result_, segmentation_->config());
  segments->header = message->header;
  labels_publisher_.publish(labels.take());
  segments_publisher_.publish(segments);

  const bool no_depth = result_.unknown_area == depth.mm.rows * depth.mm.cols;
  monitor_->setValue("segments", std::to_string(result_.segments.size()));
  monitor_->acknowledge(message->header, Outcome::kProcessed,
                        no_depth ? monitor_->resolved(depth_input_) + ": not one pixel has a depth" : "");
}

void SegmenterNodelet::publishPlan(const std_msgs::Header& header) {
  if (plan_publisher_.getNumSubscribers() == 0) return;
  const core::Optics& optics = segmentation_->config().optics;
  try {
    const FocusPlanPtr plan = toMessage(planFocus(optics, result_.segments), optics, result_.segments.size());
    plan->header = header;
    plan_publisher_.publish(plan);
  } catch (const std::invalid_argument& e) {
    monitor_->warn(e.what());  // the labels are right without the captions
  }
}

// Publishes the outputs with captions, which take longer than the labels.
void SegmenterNodelet::publishCaptioned(const std_msgs::Header& header) {
  if (picture_publisher_.getNumSubscribers() == 0 && !markers_->wanted()) return;
  CaptionSet captions{header, result_.labels.size(), static_cast<int>(result_.segments.size()), {}};
  captions.captions = captionRegions(result_, config_.caption_min_area);
  publishPicture(captions);
  markers_->publish(captions);
}

void SegmenterNodelet::publishPicture(const CaptionSet& captions) {
  if (picture_publisher_.getNumSubscribers() == 0) return;
  cv::Mat regions;
  drawRegions(result_, captions.captions, regions);
  OutgoingImage picture(captions.header, sensor_msgs::image_encodings::RGB8, regions.size());
  cv::cvtColor(regions, picture.mat, cv::COLOR_BGR2RGB);
  picture_publisher_.publish(picture.take());
}

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::SegmenterNodelet, nodelet::Nodelet)
