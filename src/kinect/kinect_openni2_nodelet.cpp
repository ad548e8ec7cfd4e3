// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <algorithm>
#include <array>
#include <chrono>
#include <future>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>

#include "kinect_device.hpp"
#include "kinect_output.hpp"
#include "kinect_parameters.hpp"
#include "lasting_thread.hpp"
#include "nodelet_of.hpp"

namespace all_in_focus {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kPollMs = 50;  // longest wait for an image; new subscribers are noticed within this time

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

}  // namespace

/// Publishes the images of a Kinect, another OpenNI2 camera or an .oni file.
///
/// One thread does everything with the camera: it opens it, starts streams, waits for images, publishes them,
/// closes it, and opens it again after an error.
class KinectOpenni2 {
 public:
  static constexpr const char* kProcessedTopic = "kinect/processed";

  KinectOpenni2(CallbackGuard& guard, NodeStatus& status)
      : status_(status), parameters_(readKinectParameters(guard.slow.private_nh, status)) {
    for (const KinectStream stream : kKinectStreams) {
      outputs_[indexOf(stream)] = std::make_unique<KinectOutput>(stream, guard.quick.nh, parameters_, status);
    }
    thread_ = runInLastingThread([this] { run(); });
  }

  ~KinectOpenni2() {
    closing_.set_value();
    thread_.wait();
  }

  KinectOpenni2(const KinectOpenni2&) = delete;
  KinectOpenni2& operator=(const KinectOpenni2&) = delete;

 private:
  void run() {
    while (!isClosing()) {
      try {
        open();
        serve();
      } catch (const std::exception& e) {
        status_.error(e.what());
        device_.reset();
        status_.setValue("device", "none");
        closed_.wait_for(seconds(parameters_.reconnect_period));
      }
    }
    device_.reset();
  }

  void open() {
    device_ = std::make_unique<KinectDevice>(parameters_.device, parameters_.playback);
    status_.recovered();
    ended_ = false;
    start_again_ = {};
    status_.setValue("device", device_->description());
    ROS_INFO_STREAM(status_.name() << ": opened " << device_->description());
  }

  // Returns when the device shall be opened again without a pause.
  void serve() {
    while (!isClosing()) {
      if (device_->isUnplugged())
        throw std::runtime_error(device_->description() + " was unplugged: waiting for it");
      const bool running = chooseStreams();
      if (ended_ && !running &&
          std::none_of(outputs_.begin(), outputs_.end(), [](auto& output) { return output->isWanted(); })) {
        device_.reset();
        return;
      }
      if (!running) {
        closed_.wait_for(std::chrono::milliseconds(kPollMs));
      } else {
        readOne();
      }
      checkSilence();
    }
  }

  /// Starts the streams that somebody subscribes to, stops the others. True if one runs.
  bool chooseStreams() {
    bool wanted = false, running = false;
    for (const auto& output : outputs_) {
      const KinectStream stream = output->stream();
      wanted = wanted || output->isWanted();
      if (device_->isRunning(stream) && (!output->isWanted() || ended_)) device_->stop(stream);
      if (!device_->isRunning(stream) && output->isWanted() && !ended_ && mayStart(*output)) {
        try {
          device_->start(stream);
          output->begin(device_->rate());
        } catch (const std::runtime_error& e) {
          start_again_[indexOf(stream)] = Clock::now() + seconds(parameters_.reconnect_period);
          status_.error(e.what());
        }
      }
      running = running || device_->isRunning(stream);
    }
    status_.setSubscribed(wanted && !ended_);
    return running;
  }

  // A Kinect delivers either IR or colour: both use the same USB pipe.
  bool mayStart(const KinectOutput& output) {
    const auto stream = output.stream();
    if (Clock::now() < start_again_[indexOf(stream)]) return false;
    if (stream == KinectStream::kDepth || device_->isFile()) return true;
    const KinectStream other = stream == KinectStream::kIr ? KinectStream::kColor : KinectStream::kIr;
    if (!device_->isRunning(other)) return true;
    status_.error("the camera gives either IR or colour: " + output.topic() +
                  " waits until nobody subscribes to " + outputs_[indexOf(other)]->topic());
    return false;
  }

  void readOne() {
    KinectFrame frame;
    if (!device_->next(frame, kPollMs)) {
      if (device_->hasEnded()) finishRecording();
      return;
    }
    silences_ = 0;
    outputs_[indexOf(frame.stream)]->publish(frame);
  }

  void finishRecording() {
    if (parameters_.playback.repeat)
      throw std::runtime_error(device_->description() + " lacks its end: playing it again");
    ended_ = true;
    ROS_INFO_STREAM(status_.name() << ": " << device_->description() << " is at its end");
    status_.setValue("device", device_->description() + ", at its end");
  }

  // Each reopening leaks memory (see OpenNiUse), so a camera that stays silent is reopened ever more rarely.
  void checkSilence() {
    if (device_->isFile() || parameters_.silence_timeout <= 0) return;
    const double limit = parameters_.silence_timeout * (1 << std::min(silences_, 6));
    for (const auto& output : outputs_) {
      if (!device_->isRunning(output->stream()) || output->silence() < seconds(limit)) continue;
      ++silences_;
      throw std::runtime_error(std::string("no ") + toString(output->stream()) + " image from " +
                               device_->description() + " for " + std::to_string(static_cast<int>(limit)) +
                               " s: opening it again");
    }
  }

  bool isClosing() const { return closed_.wait_for(Clock::duration::zero()) == std::future_status::ready; }

  NodeStatus& status_;
  const KinectParameters parameters_;

  // Used by the thread only.
  OpenNiKeeper openni_;
  std::unique_ptr<KinectDevice> device_;
  std::array<Clock::time_point, 3> start_again_{};  // next attempt after a failed start
  bool ended_ = false;
  int silences_ = 0;  // reopenings since the last image
  std::array<std::unique_ptr<KinectOutput>, 3> outputs_;

  std::promise<void> closing_;
  const std::future<void> closed_ = closing_.get_future();
  std::future<void> thread_;
};

using KinectOpenni2Nodelet = NodeletOf<KinectOpenni2>;

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::KinectOpenni2Nodelet, nodelet::Nodelet)
