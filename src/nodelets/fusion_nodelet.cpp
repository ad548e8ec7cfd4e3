// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/FusionConfig.h>
#include <dynamic_reconfigure/server.h>
#include <image_transport/image_transport.h>
#include <nodelet/nodelet.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/image_encodings.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <boost/bind/bind.hpp>
#include <cmath>
#include <memory>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <string>

#include "await_publishers.hpp"
#include "fusion_outputs.hpp"
#include "fusion_worker.hpp"
#include "node_monitor.hpp"
#include "stamp_pairing.hpp"

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr const char* kProcessedTopic = "all_in_focus/processed";
constexpr std::size_t kPairsWaiting = 64;

}  // namespace

/// Fuses focus brackets into all-in-focus images.
///
/// Callbacks run one after the other on the nodelet's own queue and only hand over to the worker. ~finish
/// waits for the worker and so runs on the multi-threaded queue.
class FusionNodelet : public nodelet::Nodelet {
 public:
  ~FusionNodelet() override;

 private:
  using Config = FusionConfig;
  using FramePairing = StampPairing<sensor_msgs::ImageConstPtr, FocusFrameConstPtr>;
  using LabelPairing = StampPairing<sensor_msgs::ImageConstPtr, SegmentArrayConstPtr>;

  void onInit() override;
  void addInputs();
  void reconfigure(Config& config);
  void connect();
  void subscribe();
  void unsubscribe();
  void arrived(int input, const ros::Time& stamp, bool is_frame = false);

  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFocus(const FocusFrameConstPtr& focus);
  void onLabels(const sensor_msgs::ImageConstPtr& labels);
  void onSegments(const SegmentArrayConstPtr& segments);
  void onDepth(const sensor_msgs::ImageConstPtr& depth);
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);
  template <typename Message>
  void pairFrame(const Message& message);
  template <typename Message>
  void pairLabels(const Message& message);
  bool finish(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  std::unique_ptr<NodeMonitor> monitor_;
  std::unique_ptr<FusionWorker> worker_;
  std::unique_ptr<dynamic_reconfigure::Server<Config>> reconfigure_server_;
  ros::ServiceServer finish_server_;
  Config config_ = Config::__getDefault__();
  int queue_size_ = 60;
  int image_input_ = 0, focus_input_ = 0, info_input_ = 0, labels_input_ = 0, segments_input_ = 0,
      depth_input_ = 0;

  std::mutex connect_mutex_;  // held while advertising: connect() may be called before onInit() is through
  std::unique_ptr<image_transport::ImageTransport> transport_;
  FusionOutputs outputs_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber depth_subscriber_, focus_subscriber_, labels_subscriber_, segments_subscriber_,
      info_subscriber_;

  FramePairing frame_pairing_{kPairsWaiting};
  LabelPairing label_pairing_{kPairsWaiting};
  bool focus_seen_ = false, awaited_ = false;  // since the subscription
  bool closing_ = false;
};

// First what calls the worker, which waits for calls under way, then the worker, then what it publishes with.
FusionNodelet::~FusionNodelet() {
  finish_server_.shutdown();
  reconfigure_server_.reset();
  {
    std::lock_guard<std::mutex> lock(connect_mutex_);
    closing_ = true;
    if (image_subscriber_) unsubscribe();
  }
  worker_.reset();
}

void FusionNodelet::onInit() {
  monitor_ =
      std::make_unique<NodeMonitor>(getName(), getMTNodeHandle(), getPrivateNodeHandle(), kProcessedTopic);
  addInputs();
  transport_ = std::make_unique<image_transport::ImageTransport>(getNodeHandle());
  ros::NodeHandle& private_nh = getPrivateNodeHandle();
  queue_size_ = std::max(1, private_nh.param("queue_size", queue_size_));
  worker_ = std::make_unique<FusionWorker>(
      *monitor_, [this](const FusedBracket& bracket) { outputs_.publish(bracket); });
  reconfigure_server_ = std::make_unique<dynamic_reconfigure::Server<Config>>(private_nh);
  reconfigure_server_->setCallback(boost::bind(&FusionNodelet::reconfigure, this, boost::placeholders::_1));
  finish_server_ = getMTPrivateNodeHandle().advertiseService("finish", &FusionNodelet::finish, this);
  {
    std::lock_guard<std::mutex> lock(connect_mutex_);
    outputs_.advertise(getNodeHandle(), *monitor_, [this] { connect(); });
  }
  monitor_->start();
}

void FusionNodelet::addInputs() {
  image_input_ = monitor_->addInput("rgb/image", Expect::kStream, "start the colour camera's driver");
  focus_input_ = monitor_->addInput("rgb/focus", Expect::kOptional, "");
  info_input_ = monitor_->addInput("rgb/camera_info", Expect::kOnce, "start the colour camera's driver");
  labels_input_ = monitor_->addInput("segmentation/labels", Expect::kOnce, "start the segmenter");
  segments_input_ = monitor_->addInput("segmentation/segments", Expect::kOnce, "start the segmenter");
  depth_input_ = monitor_->addInput("depth_registered/image", Expect::kOnce, "start depth_preprocess");
}

// dynamic_reconfigure clamps before it calls, so its ranges admit impossible values for this to see.
void FusionNodelet::reconfigure(Config& config) {
  std::string remarks;
  const auto repair = [&remarks](auto& value, const auto& good, bool possible, const char* name) {
    if (possible) return;
    remarks += std::string(remarks.empty() ? "" : ", ") + name;
    value = good;
  };
  const auto not_negative = [](double value) { return std::isfinite(value) && value >= 0; };
  repair(config.mode, config_.mode, config.mode == "paper" || config.mode == "refined", "mode");
  repair(config.bracket_mode, config_.bracket_mode,
         config.bracket_mode == "bracket" || config.bracket_mode == "sliding", "bracket_mode");
  repair(config.bracket_size, config_.bracket_size, config.bracket_size >= 0, "bracket_size");
  repair(config.bracket_gap, config_.bracket_gap, not_negative(config.bracket_gap), "bracket_gap");
  repair(config.label_max_age, config_.label_max_age, not_negative(config.label_max_age), "label_max_age");
  repair(config.label_timeout, config_.label_timeout, not_negative(config.label_timeout), "label_timeout");
  if (!remarks.empty()) monitor_->warn("impossible configuration, kept as it was: " + remarks);
  config_ = config;

  FusionSettings settings;
  settings.mode = config.mode == "paper" ? Mode::kPaper : Mode::kRefined;
  settings.reference = config.reference;
  settings.sliding = config.bracket_mode == "sliding";
  settings.bracket = {config.bracket_size, config.bracket_gap};
  settings.label_max_age_s = config.label_max_age;
  settings.label_timeout_s = config.label_timeout;
  settings.max_queued_frames = queue_size_;
  worker_->configure(settings);
  if (settings.mode == Mode::kRefined) {
    NODELET_WARN("refined fusion is not in this version: regions are fused as in mode paper");
  }
}

// Works only while somebody listens.
void FusionNodelet::connect() {
  std::lock_guard<std::mutex> lock(connect_mutex_);
  if (closing_) return;
  const bool is_wanted = outputs_.wanted();
  if (is_wanted && !image_subscriber_) {
    subscribe();
  } else if (!is_wanted && image_subscriber_) {
    unsubscribe();
  }
}

void FusionNodelet::subscribe() {
  ros::NodeHandle& nh = getNodeHandle();
  const image_transport::TransportHints hints("raw", ros::TransportHints(), getPrivateNodeHandle());
  // Depth and labels go by plain ROS: lossy transports would destroy them. They are there before colour
  // comes.
  depth_subscriber_ = nh.subscribe("depth_registered/image", queue_size_, &FusionNodelet::onDepth, this);
  labels_subscriber_ = nh.subscribe("segmentation/labels", queue_size_, &FusionNodelet::onLabels, this);
  segments_subscriber_ = nh.subscribe("segmentation/segments", queue_size_, &FusionNodelet::onSegments, this);
  info_subscriber_ = nh.subscribe("rgb/camera_info", 5, &FusionNodelet::onInfo, this);
  focus_subscriber_ = nh.subscribe("rgb/focus", queue_size_, &FusionNodelet::onFocus, this);
  image_subscriber_ = transport_->subscribe("rgb/image", queue_size_, &FusionNodelet::onImage, this, hints);
  monitor_->setSubscribed(true);
}

void FusionNodelet::unsubscribe() {
  image_subscriber_.shutdown();
  image_subscriber_ = {};
  for (ros::Subscriber* s : {&depth_subscriber_, &labels_subscriber_, &segments_subscriber_,
                             &info_subscriber_, &focus_subscriber_}) {
    s->shutdown();
  }
  frame_pairing_.clear();
  label_pairing_.clear();
  focus_seen_ = awaited_ = false;
  worker_->stopListening();
  monitor_->setSubscribed(false);
}

// A jump back shows on any input first, and again where an old message was still under way. Frames that came
// before may be new already, so only frames end the open bracket. The message itself may have been under way
// when /clock jumped.
void FusionNodelet::arrived(int input, const ros::Time& stamp, bool is_frame) {
  if (!monitor_->inputArrived(input, stamp)) return;
  const ros::Time now = std::min(stamp, ros::Time::now());
  if (is_frame) frame_pairing_.forgetAfter(now);
  label_pairing_.forgetAfter(now);
  worker_->timeWentBack(now, is_frame);
}

void FusionNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  // Without its rgb/focus or its labels the first bracket would be another one.
  if (!awaited_) awaitPublishers({&focus_subscriber_, &labels_subscriber_});
  awaited_ = true;
  arrived(image_input_, image->header.stamp, /*is_frame=*/true);
  worker_->expectLabels(labels_subscriber_.getNumPublishers() > 0);
  // Once rgb/focus is there, it says what a bracket is.
  if (focus_seen_ || focus_subscriber_.getNumPublishers() > 0) {
    pairFrame(image);
  } else {
    worker_->addFrame({image, nullptr});
  }
}

void FusionNodelet::onFocus(const FocusFrameConstPtr& focus) {
  arrived(focus_input_, focus->header.stamp, /*is_frame=*/true);
  focus_seen_ = true;
  pairFrame(focus);
}

void FusionNodelet::onLabels(const sensor_msgs::ImageConstPtr& labels) {
  arrived(labels_input_, labels->header.stamp);
  pairLabels(labels);
}

void FusionNodelet::onSegments(const SegmentArrayConstPtr& segments) {
  arrived(segments_input_, segments->header.stamp);
  pairLabels(segments);
}

void FusionNodelet::onDepth(const sensor_msgs::ImageConstPtr& depth) {
  arrived(depth_input_, depth->header.stamp);
  worker_->addDepth(depth);
}

void FusionNodelet::onInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  arrived(info_input_, info->header.stamp);
  outputs_.setCameraInfo(info);
}

template <typename Message>
void FusionNodelet::pairFrame(const Message& message) {
  FramePairing::Pair pair;
  std::vector<FramePairing::Pair> unmatched;
  const bool complete = frame_pairing_.add(message, pair, unmatched);
  for (const auto& [image, focus] : unmatched) {
    if (image) {
      monitor_->consumed(image->header, Outcome::kUnmatched,
                         "colour frame without a rgb/focus message of the same stamp");
    } else {
      monitor_->count(Outcome::kUnmatched);
    }
  }
  if (complete) worker_->addFrame({pair.first, pair.second});
}

template <typename Message>
void FusionNodelet::pairLabels(const Message& message) {
  LabelPairing::Pair pair;
  std::vector<LabelPairing::Pair> unmatched;
  const bool complete = label_pairing_.add(message, pair, unmatched);
  monitor_->count(Outcome::kUnmatched, unmatched.size());
  if (!complete) return;
  const sensor_msgs::Image& labels = *pair.first;
  if (labels.encoding != enc::TYPE_32SC1 || labels.data.size() < std::size_t{labels.step} * labels.height ||
      labels.data.empty()) {
    monitor_->count(Outcome::kInvalid);
    monitor_->error(monitor_->resolved(labels_input_) + ": labels must be 32SC1 and not empty, not " +
                    labels.encoding);
    return;
  }
  worker_->addLabels({pair.first, pair.second});
}

bool FusionNodelet::finish(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  const int published = worker_->finish();
  response.success = published >= 0;
  response.message =
      published >= 0 ? std::to_string(published) + " brackets published" : "the fusion did not end in time";
  return true;
}

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::FusionNodelet, nodelet::Nodelet)
