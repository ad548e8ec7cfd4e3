// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion_inputs.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "image_limit.hpp"
#include "topics.hpp"

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

// Callbacks hand over at once; what waits there is bounded and counted.
constexpr std::uint32_t kArrivingImages = 64, kArrivingMessages = 1000;
// Images that may wait for FocusFrame messages, and the reverse: a camera may send the pictures of a sweep
// after its end.
constexpr std::uint32_t kMostUnmatched = 1024;
constexpr double kSettleTime = 1, kSettlePeriod = 0.02;  // s of wall time
constexpr double kAheadOfClock = 0.1;                    // s that a frame may be ahead of /clock
constexpr double kDefaultGap = 1;                        // s
constexpr std::chrono::seconds kPatience(5);             // before a warning

}  // namespace

FusionInputs::FusionInputs(CallbackGuard& guard, NodeStatus& status, SceneCache& scenes, FusionWorker& worker)
    : guard_(guard),
      status_(status),
      scenes_(scenes),
      worker_(worker),
      image_input_(status.addInput(topics::kImage, Expect::kStream, "start the colour camera's driver")),
      focus_input_(status.addInput(topics::kFocus, Expect::kOptional, "")),
      segments_input_(status.addInput(topics::kSegments, Expect::kOnce, "start the segmenter")),
      scene_inputs_{status.addInput(topics::kDepth, Expect::kOnce, "start depth_preprocess"),
                    status.addInput(topics::kMeasured, Expect::kOptional, ""),
                    status.addInput(topics::kLabels, Expect::kOnce, "start the segmenter"),
                    status.addInput(topics::kColorInfo, Expect::kOnce, "start the colour camera's driver"),
                    status.addInput(topics::kOptics, Expect::kOptional, "")} {
  const auto on_timer = [this](const ros::WallTimerEvent&) { settle(); };
  settling_ =
      guard.quick.nh.createWallTimer(ros::WallDuration(kSettlePeriod), guard.wrap("publishers", on_timer),
                                     /*oneshot=*/false, /*autostart=*/false);
  restartMatcher();
}

template <typename Message, typename Use>
void FusionInputs::subscribeTo(int input, std::uint32_t queue_size, Use use) {
  const auto on_message = [this, input, use](const auto& message) {
    if (time_jumps_.clockWentBack()) startAfresh(input, ros::Time::now());
    use(message);
  };
  subscribers_.push_back(guard_.subscribe<Message>(guard_.quick, input, queue_size, on_message));
}

void FusionInputs::subscribe() {
  updatePublished(/*assumed=*/true);
  // Depth and labels use plain ROS, because lossy transports would destroy them. They are subscribed first,
  // so that they are there when colour comes.
  subscribeTo<sensor_msgs::Image>(inputOf(SceneTopic::kMeasured), kArrivingImages,
                                  [this](const auto& measured) { scenes_.addMeasured(measured); });
  subscribeTo<sensor_msgs::Image>(inputOf(SceneTopic::kDepth), kArrivingImages,
                                  [this](const auto& depth) { scenes_.addDepth(depth); });
  subscribeTo<sensor_msgs::Image>(inputOf(SceneTopic::kLabels), kArrivingImages,
                                  [this](const auto& labels) { onLabels(labels); });
  subscribeTo<SegmentArray>(segments_input_, kArrivingMessages,
                            [this](const auto& segments) { scenes_.addSegments(segments); });
  subscribeTo<sensor_msgs::CameraInfo>(inputOf(SceneTopic::kCamera), kArrivingMessages,
                                       [this](const auto& info) { scenes_.setCamera(info); });
  const auto on_optics = [this](const auto& optics) { onOptics(optics); };
  subscribers_.push_back(
      guard_.subscribe<OpticsMsg>(guard_.quick, inputOf(SceneTopic::kOptics), kArrivingMessages, on_optics));
  const auto on_focus = [this](const auto& focus) { onFocus(focus); };
  subscribers_.push_back(
      guard_.subscribe<FocusFrame>(guard_.quick, focus_input_, kArrivingMessages, on_focus));
  image_subscriber_ = guard_.receiveImages(image_input_, [this](const auto& image) { onImage(image); });
  status_.setSubscribed(true);
}

void FusionInputs::unsubscribe() {
  settling_.stop();
  settled_ = false;
  settle_until_ = {};
  image_subscriber_ = {};
  subscribers_.clear();
  images_.clear();
  restartMatcher();
  last_focus_ = last_frame_ = {};
  status_.setExpect(image_input_, Expect::kStream);
  worker_.cancel();
  scenes_.clear();
  status_.setSubscribed(false);
}

void FusionInputs::configure(double gap_s) {
  time_jumps_.setTolerance(gap_s > 0 ? gap_s : kDefaultGap);
}

// assumed: until publishers have had time to connect.
void FusionInputs::updatePublished(bool assumed) {
  for (std::size_t topic = 0; topic < kSceneTopics; ++topic)
    scenes_.setPublished(static_cast<SceneTopic>(topic),
                         assumed || status_.publishers(scene_inputs_[topic]) > 0);
}

// After the first frame other publishers may still be connecting. Without their messages from rgb/focus, or
// without its scene, the first bracket would be cut or fused differently.
void FusionInputs::settle() {
  if (settled_) return;
  const ros::WallTime now = ros::WallTime::now();
  if (settle_until_.isZero()) settle_until_ = now + ros::WallDuration(kSettleTime);
  const bool all_published = status_.publishers(focus_input_) > 0 &&
                             std::all_of(scene_inputs_.begin(), scene_inputs_.end(),
                                         [this](int i) { return status_.publishers(i) > 0; });
  if (now < settle_until_ && !all_published) return;
  settled_ = true;
  settling_.stop();
  updatePublished(/*assumed=*/false);
  if (status_.publishers(focus_input_) > 0) return;
  // The publisher has gone. Images that it had announced still wait for their messages; the others are plain.
  const auto plain_begin = std::stable_partition(images_.begin(), images_.end(),
                                                 [this](const auto& image) { return isAnnounced(*image); });
  const std::vector<sensor_msgs::ImageConstPtr> plain(plain_begin, images_.end());
  images_.erase(plain_begin, images_.end());
  if (last_focus_.isZero()) restartMatcher();  // it holds the plain images
  for (const sensor_msgs::ImageConstPtr& image : plain) addPlain(image);
}

// Whether rgb/focus has reached the image's time.
bool FusionInputs::isAnnounced(const sensor_msgs::Image& image) const {
  return !last_focus_.isZero() && image.header.stamp <= last_focus_;
}

// What is newer than the new time is forgotten. The open bracket ends with what it has, unless its frames are
// those of the new time already: they may overtake /clock. Unmatched images belong to that time to which
// their stamps are nearer: some of the new time may have overtaken rgb/focus.
void FusionInputs::startAfresh(int input, const ros::Time& now) {
  status_.timeWentBack(input);
  scenes_.forgetAfter(now);
  const ros::Time before = last_frame_;
  if (secondsBetween(now, before) <= kAheadOfClock) return;
  last_focus_ = last_frame_ = {};
  worker_.restart();
  const auto is_of_before = [&](const sensor_msgs::ImageConstPtr& image) {
    const ros::Time& stamp = image->header.stamp;
    if (std::abs(secondsBetween(stamp, now)) <= std::abs(secondsBetween(stamp, before))) return false;
    status_.acknowledge(image->header, Outcome::kUnmatched, "time went back");
    return true;
  };
  images_.erase(std::remove_if(images_.begin(), images_.end(), is_of_before), images_.end());
  restartMatcher();  // greater stamps, of before, would displace all new ones
}

// A new matcher holds the images that are not matched yet, and no message of rgb/focus.
void FusionInputs::restartMatcher() {
  matcher_ = std::make_unique<Matcher>(ExactTime(kMostUnmatched));
  matcher_->registerCallback(&FusionInputs::onFrame, this);
  last_match_ = std::chrono::steady_clock::now();
  for (const sensor_msgs::ImageConstPtr& image : images_) matcher_->add<0>(image);
}

void FusionInputs::onImage(const sensor_msgs::ImageConstPtr& image) {
  if (settled_) {
    updatePublished(/*assumed=*/false);
  } else {
    settling_.start();
  }
  // A publisher of rgb/focus defines the brackets while it is there.
  const bool has_focus = status_.publishers(focus_input_) > 0 || isAnnounced(*image);
  if (settled_ && !has_focus) {
    giveUpAllImages();  // the publisher of rgb/focus is gone
    return addPlain(image);
  }
  if (time_jumps_.clockWentBack()) startAfresh(image_input_, ros::Time::now());
  if (images_.empty()) last_match_ = std::chrono::steady_clock::now();
  images_.push_back(image);
  matcher_->add<0>(image);
  if (images_.size() > imageLimit(kMostUnmatched, *image)) giveUpAllImages();
  warnOfMismatch();
}

void FusionInputs::addPlain(const sensor_msgs::ImageConstPtr& image) {
  const ros::Time stamp = image->header.stamp;
  if (time_jumps_.streamWentBack(stamp)) startAfresh(image_input_, std::min(stamp, ros::Time::now()));
  last_frame_ = stamp;
  status_.setExpect(image_input_, Expect::kStream);
  worker_.add({image, nullptr});
}

// rgb/focus is sent at the shutter; the image may come much later.
void FusionInputs::onFocus(const FocusFrameConstPtr& focus) {
  const ros::Time stamp = focus->header.stamp;
  if (time_jumps_.streamWentBack(stamp)) startAfresh(focus_input_, std::min(stamp, ros::Time::now()));
  worker_.announce(*focus);
  last_focus_ = last_frame_ = stamp;
  matcher_->add<1>(focus);
  warnOfMismatch();
}

// Topics keep their order: images that came before this one and are not matched will never be.
void FusionInputs::onFrame(const sensor_msgs::ImageConstPtr& image, const FocusFrameConstPtr& focus) {
  const auto found = std::find(images_.begin(), images_.end(), image);
  if (found == images_.end()) return;  // given up before
  giveUpImages(static_cast<std::size_t>(found - images_.begin()));
  images_.pop_front();
  last_match_ = std::chrono::steady_clock::now();
  status_.setExpect(image_input_, Expect::kOnce);  // the camera may be silent between brackets
  worker_.add({image, focus});
}

// The oldest ones.
void FusionInputs::giveUpImages(std::size_t count) {
  for (; count > 0; --count) {
    status_.acknowledge(images_.front()->header, Outcome::kUnmatched,
                        "colour frame without a rgb/focus message of the same stamp");
    images_.pop_front();
  }
}

void FusionInputs::giveUpAllImages() {
  if (images_.empty()) return;
  giveUpImages(images_.size());
  restartMatcher();  // it holds them
}

void FusionInputs::warnOfMismatch() {
  if (images_.empty() || std::chrono::steady_clock::now() - last_match_ < kPatience) return;
  double nearest_s = std::numeric_limits<double>::infinity();
  for (const sensor_msgs::ImageConstPtr& image : images_)
    nearest_s = std::min(nearest_s, std::abs(secondsBetween(image->header.stamp, last_focus_)));
  status_.warn(
      cv::format("%zu colour frames wait for a rgb/focus message of the same stamp; the nearest one "
                 "differs by %g s",
                 images_.size(), nearest_s));
}

void FusionInputs::onOptics(const OpticsConstPtr& optics) {
  if (status_.publishers(inputOf(SceneTopic::kOptics)) > 1)
    status_.warn(status_.resolved(inputOf(SceneTopic::kOptics)) +
                 " has several publishers: the last message counts");
  scenes_.setOptics(optics);
}

void FusionInputs::onLabels(const sensor_msgs::ImageConstPtr& labels) {
  const bool is_whole =
      !labels->data.empty() && labels->data.size() >= std::size_t{labels->step} * labels->height;
  if (labels->encoding != enc::TYPE_32SC1 || !is_whole)
    throw std::invalid_argument("labels must be 32SC1 and not empty, not " + labels->encoding);
  scenes_.addLabels(labels);
}

}  // namespace all_in_focus
