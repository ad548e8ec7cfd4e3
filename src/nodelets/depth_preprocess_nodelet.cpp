// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/DepthPreprocessConfig.h>
#include <image_transport/image_transport.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>

#include <boost/make_shared.hpp>
#include <memory>
#include <pluginlib/class_list_macros.hpp>

#include "all_in_focus/pipeline.hpp"
#include "all_in_focus/rig_checks.hpp"
#include "conversions.hpp"
#include "image_limit.hpp"
#include "nodelet_of.hpp"
#include "parameters.hpp"
#include "time_jumps.hpp"
#include "topics.hpp"

namespace all_in_focus {
namespace {

constexpr double kRetryPeriod = 0.1;  // s, while a depth image waits for the transform
constexpr double kPatience = 3.0;     // s; a longer wait is an error. rig_publisher takes up to 2 s to start

// Frame id as tf2 wants it: without a slash.
std::string frameOf(const std_msgs::Header& header, const std::string& topic) {
  const std::string& frame = header.frame_id;
  if (frame.empty())
    throw std::invalid_argument(topic + ": frame_id is empty: set it in the camera's driver");
  return frame[0] == '/' ? frame.substr(1) : frame;
}

}  // namespace

/// Registers depth images to the colour camera and fills their holes.
///
/// Callbacks run one after the other; transforms are taken beside them, also while an image is processed.
class DepthPreprocess {
 public:
  static constexpr const char* kProcessedTopic = "depth_registered/processed";

  DepthPreprocess(CallbackGuard& guard, NodeStatus& status)
      : guard_(guard),
        status_(status),
        depth_input_(status.addInput("depth/image_raw", Expect::kStream, "start the depth camera's driver")),
        depth_info_input_(
            status.addInput("depth/camera_info", Expect::kOnce, "start the depth camera's driver")),
        rgb_info_input_(
            status.addInput(topics::kColorInfo, Expect::kOnce, "start the colour camera's driver")),
        moving_subscriber_(listenToTransforms("/tf", /*is_static=*/false)),
        static_subscriber_(listenToTransforms("/tf_static", /*is_static=*/true)) {
    readNumber(guard.slow.private_nh, "queue_size", 1, kMostWaiting, queue_size_, status);
    readInvalidValues(guard.slow.private_nh, invalid_values_, status);
    configuration_ = serveConfiguration<DepthPreprocessConfig>(guard.slow.private_nh, guard, status,
                                                               [this](auto& config) { reconfigure(config); });
    advertise();
  }

 private:
  // As tf2_ros::TransformListener does. A transform with an impossible stamp would end that one and the whole
  // process; here it is refused and reported.
  ros::Subscriber listenToTransforms(const std::string& topic, bool is_static) {
    return guard_.subscribe<tf2_msgs::TFMessage>(
        guard_.quick, status_.addInput(topic, Expect::kOptional, ""),
        [this, is_static](const auto& message) { addTransforms(*message, is_static); });
  }

  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static) {
    const ros::Time now = ros::Time::now();
    if (now < last_transform_) tf_buffer_.clear();  // time went back: all moving transforms are out of date
    last_transform_ = now;
    for (const geometry_msgs::TransformStamped& transform : message.transforms) {
      requirePossible(transform.header.stamp);
      tf_buffer_.setTransform(transform, "all_in_focus", is_static);
    }
  }

  void advertise() {
    ros::NodeHandle& nh = guard_.slow.nh;
    image_transport::ImageTransport transport(nh);
    const auto on_connect = guard_.wrap([this](const auto& /*subscriber*/) { connect(); });

    registered_publisher_ =
        transport.advertise(status_.addOutput(topics::kMeasured), 1, on_connect, on_connect);
    filled_publisher_ = transport.advertise(status_.addOutput(topics::kDepth), 1, on_connect, on_connect);
    info_publisher_ = nh.advertise<sensor_msgs::CameraInfo>(status_.addOutput(topics::kDepthInfo), 1,
                                                            on_connect, on_connect);
  }

  void reconfigure(DepthPreprocessConfig& config) {
    repair(config.mode, config_.mode, config.mode == "paper" || config.mode == "refined", "mode",
           "paper or refined", status_);
    config_ = config;
    preprocessing_.reset();
  }

  // Works only while anybody subscribes.
  void connect() {
    const bool wanted = anybodyListens(registered_publisher_, filled_publisher_, info_publisher_);
    if (wanted == status_.subscribed()) return;
    wanted ? subscribe() : unsubscribe();
    status_.setSubscribed(wanted);
  }

  void subscribe() {
    const auto subscribe = [&](int input, sensor_msgs::CameraInfoConstPtr& slot) {
      return guard_.subscribe<sensor_msgs::CameraInfo>(guard_.slow, input, [this, &slot](const auto& info) {
        slot = info;
        processWaiting();
      });
    };
    depth_info_subscriber_ = subscribe(depth_info_input_, depth_info_);
    rgb_info_subscriber_ = subscribe(rgb_info_input_, rgb_info_);
    depth_subscriber_ =
        guard_.subscribeToDepth(depth_input_, queue_size_, [this](const auto& depth) { onDepth(depth); });
    retry_timer_ =
        guard_.slow.nh.createWallTimer(ros::WallDuration(kRetryPeriod),
                                       guard_.wrap([this](const ros::WallTimerEvent&) { processWaiting(); }));
  }

  void unsubscribe() {
    retry_timer_.stop();
    depth_subscriber_ = {};
    depth_info_subscriber_ = rgb_info_subscriber_ = {};
    waiting_.reset();
    waiting_since_ = ros::WallTime();
    depth_info_ = rgb_info_ = nullptr;  // may be out of date when the next subscriber comes
  }

  void onDepth(const sensor_msgs::ImageConstPtr& depth) {
    if (waiting_) status_.acknowledge(waiting_->header, Outcome::kUnmatched);
    waiting_ = depth;
    processWaiting();
  }

  // Camera infos and the transform usually come within a moment. The newest depth image waits for them,
  // because it may be the only one in a bag.
  void processWaiting() {
    if (!waiting_ || !depth_info_ || !rgb_info_) return;  // the status names silent inputs
    const ros::WallTime now = ros::WallTime::now();
    if (waiting_since_.isZero()) waiting_since_ = now;
    const sensor_msgs::ImageConstPtr depth = waiting_;
    try {
      process(depth);
    } catch (const tf2::TransformException& e) {  // it may still come
      if ((now - waiting_since_).toSec() > kPatience) status_.error(e.what());
      return;
    } catch (const std::exception& e) {
      status_.acknowledge(depth->header, Outcome::kInvalid, e.what());
    }
    waiting_.reset();
    waiting_since_ = ros::WallTime();
  }

  // From the depth camera to the colour camera.
  RigidTransform transform(const std_msgs::Header& depth) {
    const std::string from = frameOf(depth, status_.resolved(depth_input_)),
                      to = frameOf(rgb_info_->header, status_.resolved(rgb_info_input_));
    try {
      const geometry_msgs::Transform found = tf_buffer_.lookupTransform(to, from, ros::Time(0)).transform;
      const geometry_msgs::Quaternion& q = found.rotation;
      const geometry_msgs::Vector3& t = found.translation;
      return RigidTransform::fromQuaternion(q.x, q.y, q.z, q.w, {t.x, t.y, t.z});
    } catch (const tf2::TransformException& e) {
      throw tf2::TransformException(
          "no transform from depth frame \"" + from + "\" to colour frame \"" + to +
          "\": publish it, e.g. rosrun tf2_ros static_transform_publisher x y z qx qy qz qw " + to + " " +
          from + " (" + e.what() + ")");
    }
  }

  void process(const sensor_msgs::ImageConstPtr& message) {
    const std::string topic = status_.resolved(depth_input_);
    const RigidTransform depth_to_color = transform(message->header);
    const cv::Mat depth = toDepth(*message, invalid_values_, topic);
    const Rig rig = {toCamera(*depth_info_, status_.resolved(depth_info_input_)),
                     toCamera(*rgb_info_, status_.resolved(rgb_info_input_)), depth_to_color};
    requireSize(depth, rig.depth, topic, status_.resolved(depth_info_input_));
    if (!preprocessing_ || !(preprocessing_->rig() == rig))
      preprocessing_ = std::make_unique<DepthPreprocessing>(rig, parseMode(config_.mode));
    std_msgs::Header header = message->header;
    header.frame_id = rgb_info_->header.frame_id;
    cv::Mat measured, filled;
    const auto blank = [&](cv::Mat& pixels) {
      return blankImage(header, sensor_msgs::image_encodings::TYPE_16UC1, rig.color.size, pixels);
    };
    const sensor_msgs::ImagePtr measured_message = blank(measured), filled_message = blank(filled);
    preprocessing_->compute(depth, measured, filled);

    const auto info = boost::make_shared<sensor_msgs::CameraInfo>(*rgb_info_);
    info->header = header;
    info_publisher_.publish(info);
    registered_publisher_.publish(measured_message);
    filled_publisher_.publish(config_.fill_holes ? filled_message : measured_message);
    status_.acknowledge(message->header, Outcome::kProcessed);
    warnOfRig(depth, measured);
  }

  // Warns of likely mistakes in the rig, in the words of fuse_stack.
  void warnOfRig(const cv::Mat& depth, const cv::Mat& registered) {
    const std::string topic = status_.resolved(depth_input_) + ": ";
    if (cv::countNonZero(depth) == 0) {
      status_.warn(topic + "not one pixel has a depth: is something too near, or the sensor covered?");
      return;
    }
    const Rig& rig = preprocessing_->rig();
    std::vector<std::string> warnings{
        core::checkDepthUnit(depth), core::checkPrincipalPoint(rig.depth, "depth"),
        core::checkPrincipalPoint(rig.color, "colour"), core::checkPose(rig.depth_to_color)};
    try {
      warnings.push_back(core::checkCoverage(registered, rig));
    } catch (const std::invalid_argument& e) {
      status_.error(topic + e.what());
    }
    for (const std::string& warning : warnings) {
      if (!warning.empty()) status_.warn(topic + warning);
    }
  }

  CallbackGuard& guard_;
  NodeStatus& status_;
  const int depth_input_, depth_info_input_, rgb_info_input_;
  tf2_ros::Buffer tf_buffer_;
  ros::Time last_transform_;  // when it came
  ros::Subscriber moving_subscriber_, static_subscriber_;
  int queue_size_ = 5;
  std::vector<int> invalid_values_{0, 2047, 65535};
  DepthPreprocessConfig config_ = DepthPreprocessConfig::__getDefault__();  // always possible
  image_transport::Publisher registered_publisher_, filled_publisher_;
  ros::Publisher info_publisher_;
  sensor_msgs::ImageConstPtr waiting_;  // for camera infos and the transform
  ros::WallTime waiting_since_;         // since when images wait; zero: none does
  sensor_msgs::CameraInfoConstPtr depth_info_, rgb_info_;
  std::unique_ptr<DepthPreprocessing> preprocessing_;  // empty: the configuration has changed

  image_transport::Subscriber depth_subscriber_;
  ros::Subscriber depth_info_subscriber_, rgb_info_subscriber_;
  ros::WallTimer retry_timer_;
  std::unique_ptr<dynamic_reconfigure::Server<DepthPreprocessConfig>> configuration_;
};

using DepthPreprocessNodelet = NodeletOf<DepthPreprocess>;

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::DepthPreprocessNodelet, nodelet::Nodelet)
