// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_inputs.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <vector>

#include "image_limit.hpp"
#include "transports.hpp"

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr std::size_t kFramesWaiting =
    1024;  // stamps: a camera may send the pictures of a sweep after its end
constexpr std::size_t kLabelsWaiting = 64;
// Callbacks hand over at once; what waits there is bounded and counted.
constexpr std::uint32_t kArrivingImages = 64, kArrivingMessages = 1000;

bool isPublished(const ros::Subscriber& subscriber) {
  return subscriber && subscriber.getNumPublishers() > 0;
}

}  // namespace

FusionInputs::FusionInputs(CallbackGuard& guard, NodeStatus& status, SceneCache& scenes, FrameQueue& frames)
    : guard_(guard),
      status_(status),
      scenes_(scenes),
      frames_(frames),
      image_input_(status.addInput("rgb/image", Expect::kStream, "start the colour camera's driver")),
      focus_input_(status.addInput("rgb/focus", Expect::kOptional, "")),
      info_input_(status.addInput("rgb/camera_info", Expect::kOnce, "start the colour camera's driver")),
      labels_input_(status.addInput("segmentation/labels", Expect::kOnce, "start the segmenter")),
      segments_input_(status.addInput("segmentation/segments", Expect::kOnce, "start the segmenter")),
      depth_input_(status.addInput("depth_registered/image", Expect::kOnce, "start depth_preprocess")),
      measured_input_(status.addInput("depth_registered/image_raw", Expect::kOptional, "")),
      time_jumps_([this](int input) { status_.timeWentBack(input); }),
      frame_matcher_(
          kFramesWaiting,
          [this](const auto& image, const auto& focus) {
            addFrame({image, focus});
          },
          [this](const auto& image, const auto&) {
            onUnmatchedFrame(image, "colour frame without a rgb/focus message of the same stamp");
          }),
      late_matcher_(
          kFramesWaiting,
          [this](const auto& image, const auto& focus) {
            frames_.add({image, focus}, unclear_ ? FrameQueue::Time::kUnclear : FrameQueue::Time::kBefore);
          },
          [this](const auto& image, const auto&) { onUnmatchedFrame(image, ""); }),
      label_matcher_(
          kLabelsWaiting, [this](const auto& labels, const auto& segments) { onLabelSet(labels, segments); },
          [this](const auto&, const auto&) { status_.count(Outcome::kUnmatched); }) {}

// Ignores messages that were sent before time jumped back.
template <typename Message, typename Use>
ros::Subscriber FusionInputs::subscribeTo(int input, std::uint32_t queue_size, Use use) {
  const auto on_message = [this, input, use](const auto& message) {
    noticeJump(input, message->header.stamp).leftover ? status_.count(Outcome::kUnmatched) : use(message);
  };
  return guard_.subscribe<Message>(input, queue_size, on_message);
}

void FusionInputs::subscribe() {
  // Depth and labels use plain ROS, because lossy transports would destroy them. They are subscribed first,
  // so that they are there when colour comes.
  updateMeasured();
  depth_subscriber_ = subscribeTo<sensor_msgs::Image>(depth_input_, kArrivingImages,
                                                      [this](const auto& depth) { scenes_.addDepth(depth); });
  labels_subscriber_ = subscribeTo<sensor_msgs::Image>(
      labels_input_, kArrivingImages, [this](const auto& labels) { label_matcher_.add(labels); });
  segments_subscriber_ = subscribeTo<SegmentArray>(
      segments_input_, kArrivingMessages, [this](const auto& segments) { label_matcher_.add(segments); });
  info_subscriber_ = subscribeTo<sensor_msgs::CameraInfo>(
      info_input_, kArrivingMessages, [this](const auto& info) { scenes_.setCamera(info); });
  focus_subscriber_ = guard_.subscribe<FocusFrame>(focus_input_, kArrivingMessages,
                                                   [this](const auto& focus) { onFocus(focus); });
  image_subscriber_ =
      guard_.subscribeToImages(image_input_, kMostWaiting, [this](const auto& image) { onImage(image); });
  status_.setSubscribed(true);
}

void FusionInputs::unsubscribe() {
  image_subscriber_ = {};
  depth_subscriber_ = measured_subscriber_ = labels_subscriber_ = segments_subscriber_ = info_subscriber_ =
      focus_subscriber_ = {};
  frame_matcher_.clear();
  late_matcher_.clear();
  label_matcher_.clear();
  focus_seen_ = awaited_ = false;
  announced_bracket_.reset();
  status_.setExpect(image_input_, Expect::kStream);
  frames_.abandon();
  scenes_.clear();
  status_.setSubscribed(false);
}

void FusionInputs::needMeasured(bool needed) {
  needs_measured_ = needed;
  if (subscribed()) updateMeasured();
}

void FusionInputs::updateMeasured() {
  if (needs_measured_ && !measured_subscriber_) {
    measured_subscriber_ = subscribeTo<sensor_msgs::Image>(
        measured_input_, kArrivingImages, [this](const auto& measured) { scenes_.addMeasured(measured); });
  } else if (!needs_measured_ && measured_subscriber_) {
    measured_subscriber_ = {};
  }
}

// A jump seen on any input empties all matching and the cache; but frames may be new already when it shows on
// another input, so only frames end the open bracket. Its last frames may be under way still: they are
// matched apart, because their stamps would push new ones out.
TimeJumps::Arrival FusionInputs::noticeJump(int input, const ros::Time& stamp, bool is_frame) {
  const TimeJumps::Arrival arrival = time_jumps_.arrived(input, stamp);
  if (arrival.jumped) {
    const ros::Time now = std::min(stamp, ros::Time::now());
    late_matcher_.forgetAfter({});
    frame_matcher_.forgetAfter(now, [this](const auto& image, const auto& focus) {
      image ? late_matcher_.add(image) : late_matcher_.add(focus);
    });
    label_matcher_.forgetAfter(now);
    scenes_.forgetAfter(now);
    if (is_frame) frames_.restart();
  }
  return arrival;
}

// A topic keeps its order: when a frame of the new time is complete, all older frames have come.
void FusionInputs::addFrame(const BracketFrame& frame) {
  late_matcher_.forgetAfter({});
  frames_.add(frame, unclear_ ? FrameQueue::Time::kUnclear : FrameQueue::Time::kNow);
}

// Whether a frame, or its message from rgb/focus, was sent before time went back.
bool FusionInputs::isLate(const TimeJumps::Arrival& arrival, const ros::Time& stamp) {
  unclear_ = arrival.unclear;
  return arrival.leftover || late_matcher_.holds(stamp);
}

void FusionInputs::onImage(const sensor_msgs::ImageConstPtr& image) {
  // Without its messages from rgb/focus or its scene the first bracket would be cut or fused differently.
  if (!awaited_) {
    std::vector<const ros::Subscriber*> others = {&focus_subscriber_, &labels_subscriber_};
    if (measured_subscriber_)
      others.insert(others.end(), {&depth_subscriber_, &measured_subscriber_, &info_subscriber_});
    awaitPublishers(others);
  }
  awaited_ = true;
  const ros::Time stamp = image->header.stamp;
  const bool is_late = isLate(noticeJump(image_input_, stamp, /*is_frame=*/true), stamp);
  scenes_.expect({isPublished(labels_subscriber_), isPublished(depth_subscriber_),
                  isPublished(measured_subscriber_), isPublished(info_subscriber_)});
  // Once rgb/focus is there, it defines the brackets, and the camera may be silent between them.
  if (focus_seen_ || isPublished(focus_subscriber_)) {
    status_.setExpect(image_input_, Expect::kOnce);
    (is_late ? late_matcher_ : frame_matcher_).add(image);
  } else if (is_late) {
    frames_.add({image, nullptr}, FrameQueue::Time::kBefore);
  } else {
    addFrame({image, nullptr});
  }
}

// rgb/focus is sent at the shutter; the image may come much later.
void FusionInputs::onFocus(const FocusFrameConstPtr& focus) {
  const ros::Time stamp = focus->header.stamp;
  if (isLate(noticeJump(focus_input_, stamp, /*is_frame=*/true), stamp)) {
    late_matcher_.add(focus);
    return;
  }
  focus_seen_ = true;
  status_.setExpect(image_input_, Expect::kOnce);
  if (focus->index == 0 || announced_bracket_ != focus->bracket_id) scenes_.pin(stamp);
  announced_bracket_ = focus->bracket_id;
  frame_matcher_.add(focus);
}

// image: null if only rgb/focus came.
void FusionInputs::onUnmatchedFrame(const sensor_msgs::ImageConstPtr& image, const char* reason) {
  image ? status_.acknowledge(image->header, Outcome::kUnmatched, reason)
        : status_.count(Outcome::kUnmatched);
}

void FusionInputs::onLabelSet(const sensor_msgs::ImageConstPtr& labels,
                              const SegmentArrayConstPtr& segments) {
  if (labels->encoding != enc::TYPE_32SC1 ||
      labels->data.size() < std::size_t{labels->step} * labels->height || labels->data.empty()) {
    status_.count(Outcome::kInvalid);
    status_.error(status_.resolved(labels_input_) + ": labels must be 32SC1 and not empty, not " +
                  labels->encoding);
    return;
  }
  scenes_.addLabels({labels, segments});
}

}  // namespace all_in_focus
