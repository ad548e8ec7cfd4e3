// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_output.hpp"

#include <opencv2/core.hpp>

namespace all_in_focus {
namespace {

constexpr std::chrono::seconds kReportPeriod{1};
constexpr int kMaxGap = 1000;  // images; a larger gap means that the camera counts anew, not a loss

std::string topicOf(KinectStream stream) {
  constexpr const char* kTopics[] = {"depth", "ir", "kinect_rgb"};  // rgb is the camera that sweeps its focus
  return kTopics[indexOf(stream)];
}

}  // namespace

KinectOutput::KinectOutput(KinectStream stream, const ros::NodeHandle& nh, const KinectParameters& parameters,
                           NodeStatus& status)
    : stream_(stream),
      parameters_(parameters),
      of_stream_(parameters.streams[indexOf(stream)]),
      status_(status),
      topic_(topicOf(stream) + "/image_raw"),
      calibration_(stream, ros::NodeHandle(nh, topicOf(stream)), of_stream_, status) {
  publisher_ = image_transport::ImageTransport(nh).advertiseCamera(topic_, parameters.queue_size);
  status_.addOutput(topic_);
  status_.addOutput(topicOf(stream) + "/camera_info");
}

void KinectOutput::begin(double rate) {
  clock_ = KinectClock(rate);
  last_arrival_ = Clock::now();
  last_index_ = 0;
}

void KinectOutput::publish(const KinectFrame& frame) {
  last_arrival_ = Clock::now();
  countLost(frame);
  std_msgs::Header header;
  header.frame_id = of_stream_.frame_id;
  try {
    publishAs(header, frame);
  } catch (const std::exception& e) {
    status_.acknowledge(
        header, Outcome::kInvalid,
        std::string(toString(stream_)) + " image " + std::to_string(frame.index) + " refused: " + e.what());
  }
}

void KinectOutput::publishAs(std_msgs::Header& header, const KinectFrame& frame) {
  header.stamp = stampOf(frame);
  if (header.stamp.isZero()) {
    status_.acknowledge(header, Outcome::kDropped,
                        "use_sim_time is set, but nobody publishes /clock: no images");
    return;
  }
  const sensor_msgs::ImagePtr image = toImage(frame, header, parameters_.invalid_values);
  const sensor_msgs::CameraInfoPtr info = calibration_.cameraInfo(frame.mode);
  info->header = header;
  publisher_.publish(image, info);
  ++published_;
  status_.acknowledge(header, Outcome::kProcessed);
  report(frame.mode);
}

// Simulated time is exact, and unrelated to the camera's clock.
ros::Time KinectOutput::stampOf(const KinectFrame& frame) {
  const ros::Time arrival = ros::Time::now();
  if (ros::Time::isSimTime()) return arrival;
  return clock_.stamp(frame.device_us, arrival) + ros::Duration(parameters_.time_offset);
}

void KinectOutput::countLost(const KinectFrame& frame) {
  const int lost = frame.index - last_index_ - 1;
  if (last_index_ > 0 && lost > 0 && lost < kMaxGap) status_.count(Outcome::kDropped, lost);
  last_index_ = frame.index;
}

void KinectOutput::report(const KinectMode& mode) {
  const auto now = Clock::now();
  const auto passed = now - reported_at_;
  if (passed < kReportPeriod) return;
  const double rate =
      static_cast<double>(published_ - reported_) / std::chrono::duration<double>(passed).count();
  status_.setValue(topic_, cv::format("%dx%d at %d Hz, %llu images, now %.1f Hz", mode.width, mode.height,
                                      mode.fps, static_cast<unsigned long long>(published_), rate));
  reported_ = published_;
  reported_at_ = now;
}

}  // namespace all_in_focus
