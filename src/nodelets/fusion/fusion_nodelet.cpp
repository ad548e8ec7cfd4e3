// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/FusionConfig.h>
#include <image_transport/subscriber.h>
#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <chrono>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>

#include "all_in_focus/fusion.hpp"
#include "conversions.hpp"
#include "fusion_outputs.hpp"
#include "fusion_worker.hpp"
#include "image_limit.hpp"
#include "nodelet_of.hpp"
#include "parameters.hpp"
#include "scene_cache.hpp"
#include "time_jumps.hpp"
#include "topics.hpp"

namespace all_in_focus {
namespace {

// Images that may wait for FocusFrame messages, and the reverse: a camera may send the pictures of a sweep
// after its end.
constexpr std::uint32_t kMostUnmatched = 1024;
constexpr const char* kJumps = "backward time jumps";  // key of the diagnostics
constexpr double kSettleTime = 1;                      // s of wall time
constexpr double kAheadOfClock = 0.1;                  // s that a frame may be ahead of /clock
constexpr double kDefaultGap = 1;                      // s
constexpr std::chrono::seconds kPatience(5);           // before a warning

// all_in_focus.launch loads the lens of the rig as ~calibration.
CalibrationLens readCalibration(const ros::NodeHandle& private_nh, NodeStatus& status) {
  constexpr double kMmPerUm = 1e-3, kLargestPitch = 1000;
  CalibrationLens lens;
  double pixel_pitch_um = 0;
  readNumber(private_nh, "pixel_pitch_um", 0.0, kLargestPitch, pixel_pitch_um, status);
  lens.pixel_pitch_mm = kMmPerUm * pixel_pitch_um;
  if (!private_nh.hasParam("calibration/focal_length_mm")) return lens;
  core::Optics optics;
  readParameter(private_nh, "calibration/focal_length_mm", optics.focal_length_mm, status);
  readParameter(private_nh, "calibration/aperture", optics.aperture, status);
  readParameter(private_nh, "calibration/circle_of_confusion_mm", optics.circle_of_confusion_mm, status);
  try {
    core::validate(optics);
    lens.optics = boost::make_shared<OpticsMsg>(toMessage(optics));
  } catch (const std::invalid_argument& e) {
    status.error(std::string("~calibration: ") + e.what() + ": the lens of the calibration is unknown");
  }
  return lens;
}

}  // namespace

/// Fuses focus brackets into all-in-focus images: inputs -> worker -> outputs. Matches frames with their
/// messages from rgb/focus. Frames go to the worker, everything else goes to the scene cache.
///
/// The quick callbacks only pass messages on. The worker and the service ~finish, which waits for it, share
/// the slow ones.
class Fusion {
 public:
  static constexpr const char* kProcessedTopic = "all_in_focus/processed";

  Fusion(CallbackGuard& guard, NodeStatus& status)
      : guard_(guard),
        status_(status),
        outputs_(guard.quick.nh, status, guard.wrap([this] { connect(); })),
        worker_(guard, status, scenes_, outputs_),
        image_input_(status.addInput(topics::kImage, Expect::kStream, "start the colour camera's driver")),
        focus_input_(status.addInput(topics::kFocus, Expect::kOptional, "")),
        depth_input_(status.addInput(topics::kDepth, Expect::kOnce, "start depth_preprocess")),
        measured_input_(status.addInput(topics::kMeasured, Expect::kOptional, "")),
        labels_input_(status.addInput(topics::kLabels, Expect::kOnce, "start the segmenter")),
        info_input_(status.addInput(topics::kColorInfo, Expect::kOnce, "start the colour camera's driver")),
        optics_input_(status.addInput(topics::kOptics, Expect::kOptional, "")) {
    restartMatcher();
    status.setValue(kJumps, "0");
    const auto on_timer = guard.wrap([this](const ros::WallTimerEvent&) { settle(); });
    settling_ = guard.quick.nh.createWallTimer(ros::WallDuration(kSettleTime), on_timer, /*oneshot=*/true,
                                               /*autostart=*/false);
    readNumber(guard.slow.private_nh, "queue_size", 1, kMostWaiting, at_start_.most_waiting, status);
    readParameter(guard.slow.private_nh, "restore_every_bracket", at_start_.restore_every, status);
    at_start_.calibration = readCalibration(guard.slow.private_nh, status);
    configuration_ = serveConfiguration<FusionConfig>(guard.quick.private_nh, guard, status,
                                                      [this](auto& config) { reconfigure(config); });
    finish_server_ = guard.slow.private_nh.advertiseService("finish", &Fusion::finish, this);
    guard.on_stop = [this] { unsubscribe(); };
  }

 private:
  using ExactTime = message_filters::sync_policies::ExactTime<sensor_msgs::Image, FocusFrame>;
  using Matcher = message_filters::Synchronizer<ExactTime>;

  void reconfigure(FusionConfig& config) {
    repairName(config.mode, config_.mode, parseMode, status_);
    repair(config.bracket_mode, config_.bracket_mode,
           config.bracket_mode == "bracket" || config.bracket_mode == "sliding", "bracket_mode",
           "bracket or sliding", status_);
    constexpr int kMostFrames = kNoFrame - 1;
    const auto check = [this](auto& value, auto good, auto least, auto most, const char* name) {
      repairNumber(value, good, least, most, name, status_);
    };
    check(config.reference, config_.reference, -1, kMostFrames, "reference");
    check(config.max_held_frames, config_.max_held_frames, 0, kMostFrames, "max_held_frames");
    check(config.bracket_size, config_.bracket_size, 0, kMostFrames, "bracket_size");
    check(config.bracket_gap, config_.bracket_gap, 0.0, 3600.0, "bracket_gap");
    check(config.label_max_age, config_.label_max_age, 0.0, 3600.0, "label_max_age");
    check(config.label_timeout, config_.label_timeout, 0.0, 60.0, "label_timeout");
    config_ = config;

    FusionSettings settings = at_start_;
    settings.bracket.mode = parseMode(config.mode);
    settings.bracket.reference = config.reference;
    settings.bracket.sliding = config.bracket_mode == "sliding";
    settings.bracket.max_held = config.max_held_frames;
    settings.ends = {config.bracket_size, config.bracket_gap};
    settings.label_timeout_s = config.label_timeout;
    scenes_.configure(/*by_labels=*/settings.bracket.mode == Mode::kPaper, config.label_max_age);
    worker_.configure(settings);
    time_jumps_.setTolerance(config.bracket_gap > 0 ? config.bracket_gap : kDefaultGap);
  }

  // Works only while somebody listens.
  void connect() {
    const bool wanted = outputs_.wanted();
    if (wanted == status_.subscribed()) return;
    wanted ? subscribe() : unsubscribe();
    status_.setSubscribed(wanted);
  }

  template <typename Message>
  void subscribeTo(int input, void (SceneCache::*use)(const boost::shared_ptr<const Message>&)) {
    const auto on_message = [this, input, use](const boost::shared_ptr<const Message>& message) {
      if (time_jumps_.clockWentBack()) startAfresh(input, ros::Time::now());
      (scenes_.*use)(message);
      if (input == optics_input_ && publishersOf(input) > 1)
        status_.warn(status_.resolved(input) + " has several publishers: the last message counts");
    };
    subscribers_[input] = guard_.subscribe<Message>(guard_.quick, input, on_message);
  }

  // Depth and labels use plain ROS, because lossy transports would destroy them. They are subscribed first,
  // so that they are there when colour comes.
  void subscribe() {
    subscribeTo(measured_input_, &SceneCache::addMeasured);
    subscribeTo(depth_input_, &SceneCache::addDepth);
    subscribeTo(labels_input_, &SceneCache::addLabels);
    subscribeTo(info_input_, &SceneCache::setCamera);
    subscribeTo(optics_input_, &SceneCache::setOptics);
    subscribers_[focus_input_] = guard_.subscribe<FocusFrame>(guard_.quick, focus_input_,
                                                              [this](const auto& focus) { onFocus(focus); });
    image_subscriber_ = guard_.receiveImages(image_input_, [this](const auto& image) { onImage(image); });
  }

  void unsubscribe() {
    settling_.stop();
    settled_ = false;
    image_subscriber_ = {};
    subscribers_.clear();
    images_.clear();
    restartMatcher();
    last_focus_ = last_frame_ = {};
    status_.setExpect(image_input_, Expect::kStream);
    worker_.cancel();
    scenes_.clear();
  }

  // Before the first frame the publisher of rgb/focus may still be connecting. Without its messages the first
  // bracket would be cut differently: until this is called, frames wait for them.
  void settle() {
    settled_ = true;
    if (publishersOf(focus_input_) > 0) return;
    // The publisher has gone. Images that it had announced still wait for their messages; the others are
    // plain.
    std::deque<sensor_msgs::ImageConstPtr> waiting;
    waiting.swap(images_);
    if (last_focus_.isZero()) restartMatcher();  // it holds the plain images
    for (const auto& image : waiting) isAnnounced(*image) ? images_.push_back(image) : addPlain(image);
  }

  // Whether rgb/focus has reached the image's time.
  bool isAnnounced(const sensor_msgs::Image& image) const {
    return !last_focus_.isZero() && image.header.stamp <= last_focus_;
  }

  // What is newer than the new time is forgotten. The open bracket ends with what it has, unless its frames
  // are those of the new time already: they may overtake /clock. Unmatched images belong to that time to
  // which their stamps are nearer: some of the new time may have overtaken rgb/focus.
  void startAfresh(int input, const ros::Time& now) {
    ROS_INFO_STREAM(status_.name() << ": time went back (" << status_.resolved(input)
                                   << "), starting afresh");
    status_.setValue(kJumps, std::to_string(++jumps_));
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
  void restartMatcher() {
    matcher_ = std::make_unique<Matcher>(ExactTime(kMostUnmatched));
    matcher_->registerCallback(&Fusion::onFrame, this);
    last_match_ = std::chrono::steady_clock::now();
    for (const sensor_msgs::ImageConstPtr& image : images_) matcher_->add<0>(image);
  }

  void onImage(const sensor_msgs::ImageConstPtr& image) {
    settling_.start();  // the first image starts it
    // A publisher of rgb/focus defines the brackets while it is there.
    const bool has_focus = publishersOf(focus_input_) > 0 || isAnnounced(*image);
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

  void addPlain(const sensor_msgs::ImageConstPtr& image) {
    const ros::Time stamp = image->header.stamp;
    if (time_jumps_.streamWentBack(stamp)) startAfresh(image_input_, std::min(stamp, ros::Time::now()));
    last_frame_ = stamp;
    status_.setExpect(image_input_, Expect::kStream);
    worker_.add({image, nullptr});
  }

  // rgb/focus is sent at the shutter; the image may come much later.
  void onFocus(const FocusFrameConstPtr& focus) {
    const ros::Time stamp = focus->header.stamp;
    if (time_jumps_.streamWentBack(stamp)) startAfresh(focus_input_, std::min(stamp, ros::Time::now()));
    worker_.announce(*focus);
    last_focus_ = last_frame_ = stamp;
    matcher_->add<1>(focus);
    warnOfMismatch();
  }

  // Topics keep their order: images that came before this one and are not matched will never be.
  void onFrame(const sensor_msgs::ImageConstPtr& image, const FocusFrameConstPtr& focus) {
    const auto found = std::find(images_.begin(), images_.end(), image);
    if (found == images_.end()) return;  // given up before
    giveUpImages(static_cast<std::size_t>(found - images_.begin()));
    images_.pop_front();
    last_match_ = std::chrono::steady_clock::now();
    status_.setExpect(image_input_, Expect::kOnce);  // the camera may be silent between brackets
    worker_.add({image, focus});
  }

  // The oldest ones.
  void giveUpImages(std::size_t count) {
    for (; count > 0; --count) {
      status_.acknowledge(images_.front()->header, Outcome::kUnmatched,
                          "colour frame without a rgb/focus message of the same stamp");
      images_.pop_front();
    }
  }

  void giveUpAllImages() {
    if (images_.empty()) return;
    giveUpImages(images_.size());
    restartMatcher();  // it holds them
  }

  void warnOfMismatch() {
    if (images_.empty() || std::chrono::steady_clock::now() - last_match_ < kPatience) return;
    double nearest_s = std::numeric_limits<double>::infinity();
    for (const sensor_msgs::ImageConstPtr& image : images_)
      nearest_s = std::min(nearest_s, std::abs(secondsBetween(image->header.stamp, last_focus_)));
    status_.warn(
        cv::format("%zu colour frames wait for a rgb/focus message of the same stamp; the nearest one "
                   "differs by %g s",
                   images_.size(), nearest_s));
  }

  bool finish(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
    const int published = worker_.finish();
    response.success = published >= 0;
    response.message =
        published >= 0 ? std::to_string(published) + " brackets published" : "nobody listens any more";
    return true;
  }

  // roscpp knows who is connected; the master, which may hang, need not be asked.
  std::uint32_t publishersOf(int input) { return subscribers_[input].getNumPublishers(); }

  CallbackGuard& guard_;
  NodeStatus& status_;
  FusionSettings at_start_;                               // what reconfigure() does not change
  FusionConfig config_ = FusionConfig::__getDefault__();  // always possible
  FusionOutputs outputs_;
  SceneCache scenes_;
  FusionWorker worker_;
  const int image_input_, focus_input_, depth_input_, measured_input_, labels_input_, info_input_,
      optics_input_;
  TimeJumps time_jumps_;
  int jumps_ = 0;  // so far

  std::unique_ptr<Matcher> matcher_;                  // image + rgb/focus
  std::deque<sensor_msgs::ImageConstPtr> images_;     // that it has not matched, from the oldest on
  std::chrono::steady_clock::time_point last_match_;  // or since when there is something to match

  bool settled_ = false;  // all publishers have had time to connect since the first frame
  ros::WallTimer settling_;
  ros::Time last_focus_, last_frame_;  // stamps: of rgb/focus; of that or a frame without it
  image_transport::Subscriber image_subscriber_;
  std::map<int, ros::Subscriber> subscribers_;  // all others, by input
  ros::ServiceServer finish_server_;
  std::unique_ptr<dynamic_reconfigure::Server<FusionConfig>> configuration_;
};

using FusionNodelet = NodeletOf<Fusion>;

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::FusionNodelet, nodelet::Nodelet)
