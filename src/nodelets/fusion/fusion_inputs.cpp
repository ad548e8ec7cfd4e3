// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_inputs.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <vector>

#include "await_publishers.hpp"
#include "transport_choice.hpp"

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr std::size_t kPairsWaiting = 64;

}  // namespace

FusionInputs::FusionInputs(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, NodeMonitor& monitor,
                           SceneCache& scenes, FusionWorker& worker)
    : nh_(nh),
      private_nh_(private_nh),
      monitor_(monitor),
      scenes_(scenes),
      worker_(worker),
      image_input_(monitor.addInput("rgb/image", Expect::kStream, "start the colour camera's driver")),
      focus_input_(monitor.addInput("rgb/focus", Expect::kOptional, "")),
      info_input_(monitor.addInput("rgb/camera_info", Expect::kOnce, "start the colour camera's driver")),
      labels_input_(monitor.addInput("segmentation/labels", Expect::kOnce, "start the segmenter")),
      segments_input_(monitor.addInput("segmentation/segments", Expect::kOnce, "start the segmenter")),
      depth_input_(monitor.addInput("depth_registered/image", Expect::kOnce, "start depth_preprocess")),
      measured_input_(monitor.addInput("depth_registered/image_raw", Expect::kOptional, "")),
      transport_(nh),
      frame_pairing_(kPairsWaiting),
      label_pairing_(kPairsWaiting) {}

void FusionInputs::subscribe(int queue_size) {
  queue_size_ = queue_size;
  const image_transport::TransportHints hints = chosenTransport(nh_, private_nh_, monitor_);
  // Depth and labels go by plain ROS: lossy transports would destroy them. They are there before colour
  // comes.
  updateMeasured();
  depth_subscriber_ = nh_.subscribe("depth_registered/image", queue_size, &FusionInputs::onDepth, this);
  labels_subscriber_ = nh_.subscribe("segmentation/labels", queue_size, &FusionInputs::onLabels, this);
  segments_subscriber_ = nh_.subscribe("segmentation/segments", queue_size, &FusionInputs::onSegments, this);
  info_subscriber_ = nh_.subscribe("rgb/camera_info", 5, &FusionInputs::onInfo, this);
  focus_subscriber_ = nh_.subscribe("rgb/focus", queue_size, &FusionInputs::onFocus, this);
  image_subscriber_ = transport_.subscribe("rgb/image", queue_size, &FusionInputs::onImage, this, hints);
  monitor_.setSubscribed(true);
}

void FusionInputs::unsubscribe() {
  image_subscriber_.shutdown();
  image_subscriber_ = {};
  for (ros::Subscriber* s : {&depth_subscriber_, &measured_subscriber_, &labels_subscriber_,
                             &segments_subscriber_, &info_subscriber_, &focus_subscriber_}) {
    s->shutdown();
  }
  measured_subscriber_ = {};
  frame_pairing_.clear();
  label_pairing_.clear();
  focus_seen_ = awaited_ = false;
  worker_.stopListening();
  scenes_.clear();
  monitor_.setSubscribed(false);
}

void FusionInputs::needMeasured(bool needed) {
  needs_measured_ = needed;
  if (subscribed()) updateMeasured();
}

void FusionInputs::updateMeasured() {
  if (needs_measured_ && !measured_subscriber_) {
    measured_subscriber_ =
        nh_.subscribe("depth_registered/image_raw", queue_size_, &FusionInputs::onMeasured, this);
  } else if (!needs_measured_ && measured_subscriber_) {
    measured_subscriber_.shutdown();
    measured_subscriber_ = {};
  }
}

// A jump back shows on any input first, and again where an old message was still under way. Frames that came
// before may be new already, so only frames end the open bracket. The message itself may have been under way
// when /clock jumped.
void FusionInputs::arrived(int input, const ros::Time& stamp, bool is_frame) {
  if (!monitor_.inputArrived(input, stamp)) return;
  const ros::Time now = std::min(stamp, ros::Time::now());
  if (is_frame) frame_pairing_.forgetAfter(now);
  label_pairing_.forgetAfter(now);
  scenes_.forgetAfter(now);
  if (is_frame) worker_.restart();
}

void FusionInputs::onImage(const sensor_msgs::ImageConstPtr& image) {
  // Without its rgb/focus or its scene the first bracket would be another one.
  if (!awaited_) {
    std::vector<const ros::Subscriber*> others = {&focus_subscriber_, &labels_subscriber_};
    if (measured_subscriber_)
      others.insert(others.end(), {&depth_subscriber_, &measured_subscriber_, &info_subscriber_});
    awaitPublishers(others);
  }
  awaited_ = true;
  arrived(image_input_, image->header.stamp, /*is_frame=*/true);
  const auto published = [](const ros::Subscriber& s) { return s && s.getNumPublishers() > 0; };
  scenes_.expect({published(labels_subscriber_), published(depth_subscriber_),
                  published(measured_subscriber_), published(info_subscriber_)});
  // Once rgb/focus is there, it says what a bracket is.
  if (focus_seen_ || published(focus_subscriber_)) {
    pairFrame(image);
  } else {
    worker_.addFrame({image, nullptr});
  }
}

void FusionInputs::onFocus(const FocusFrameConstPtr& focus) {
  arrived(focus_input_, focus->header.stamp, /*is_frame=*/true);
  focus_seen_ = true;
  pairFrame(focus);
}

void FusionInputs::onLabels(const sensor_msgs::ImageConstPtr& labels) {
  arrived(labels_input_, labels->header.stamp);
  pairLabels(labels);
}

void FusionInputs::onSegments(const SegmentArrayConstPtr& segments) {
  arrived(segments_input_, segments->header.stamp);
  pairLabels(segments);
}

void FusionInputs::onDepth(const sensor_msgs::ImageConstPtr& depth) {
  arrived(depth_input_, depth->header.stamp);
  scenes_.addDepth(depth);
}

void FusionInputs::onMeasured(const sensor_msgs::ImageConstPtr& measured) {
  arrived(measured_input_, measured->header.stamp);
  scenes_.addMeasured(measured);
}

void FusionInputs::onInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  arrived(info_input_, info->header.stamp);
  scenes_.setCamera(info);
}

template <typename Message>
void FusionInputs::pairFrame(const Message& message) {
  FramePairing::Pair pair;
  std::vector<FramePairing::Pair> unmatched;
  const bool complete = frame_pairing_.add(message, pair, unmatched);
  for (const auto& [image, focus] : unmatched) {
    if (image) {
      monitor_.consumed(image->header, Outcome::kUnmatched,
                        "colour frame without a rgb/focus message of the same stamp");
    } else {
      monitor_.count(Outcome::kUnmatched);
    }
  }
  if (complete) worker_.addFrame({pair.first, pair.second});
}

template <typename Message>
void FusionInputs::pairLabels(const Message& message) {
  LabelPairing::Pair pair;
  std::vector<LabelPairing::Pair> unmatched;
  const bool complete = label_pairing_.add(message, pair, unmatched);
  monitor_.count(Outcome::kUnmatched, unmatched.size());
  if (!complete) return;
  const sensor_msgs::Image& labels = *pair.first;
  if (labels.encoding != enc::TYPE_32SC1 || labels.data.size() < std::size_t{labels.step} * labels.height ||
      labels.data.empty()) {
    monitor_.count(Outcome::kInvalid);
    monitor_.error(monitor_.resolved(labels_input_) + ": labels must be 32SC1 and not empty, not " +
                   labels.encoding);
    return;
  }
  scenes_.addLabels({pair.first, pair.second});
}

}  // namespace all_in_focus
