// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/FusionConfig.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <std_srvs/Trigger.h>

#include <chrono>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <string>

#include "conversions.hpp"
#include "frame_queue.hpp"
#include "fusion_inputs.hpp"
#include "fusion_outputs.hpp"
#include "fusion_worker.hpp"
#include "image_limit.hpp"
#include "nodelet_of.hpp"
#include "parameters.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {
namespace {

constexpr std::chrono::seconds kFinishPatience(60);

}  // namespace

/// Fuses focus brackets into all-in-focus images: inputs -> queue -> worker -> outputs.
///
/// Callbacks run one after the other and only pass messages on. The service ~finish waits for the worker, so
/// it has a thread of its own.
class Fusion {
 public:
  static constexpr const char* kProcessedTopic = "all_in_focus/processed";

  Fusion(CallbackGuard& guard, NodeStatus& status);
  ~Fusion();
  Fusion(const Fusion&) = delete;
  Fusion& operator=(const Fusion&) = delete;

 private:
  void reconfigure(FusionConfig& config);
  void connect();
  bool finish(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  NodeStatus& status_;
  int queue_size_ = 60;
  bool restore_every_ = false;
  FusionConfig config_ = FusionConfig::__getDefault__();  // always possible
  FusionOutputs outputs_;
  SceneCache scenes_;
  FrameQueue frames_;
  FusionInputs inputs_;
  FusionWorker worker_;
  ros::CallbackQueue finish_queue_;
  ros::ServiceServer finish_server_;
  ros::AsyncSpinner finish_spinner_{1, &finish_queue_};
  std::unique_ptr<dynamic_reconfigure::Server<FusionConfig>> configuration_;
};

// A call of ~finish may be waiting for the queue; to stop the queue ends it.
Fusion::~Fusion() {
  frames_.stop();
  finish_server_.shutdown();
  finish_spinner_.stop();
}

Fusion::Fusion(CallbackGuard& guard, NodeStatus& status)
    : status_(status),
      frames_(status, scenes_),
      inputs_(guard, status, scenes_, frames_),
      worker_(status, frames_, scenes_, [this](const FusedBracket& bracket) { outputs_.publish(bracket); }) {
  readNumber(guard.private_nh, "queue_size", 1, kMostWaiting, queue_size_, status);
  readParameter(guard.private_nh, "restore_every_bracket", restore_every_, status);
  configuration_ =
      serveConfiguration<FusionConfig>(guard, status, [this](auto& config) { reconfigure(config); });
  ros::NodeHandle finish_nh(guard.private_nh);
  finish_nh.setCallbackQueue(&finish_queue_);
  finish_server_ = finish_nh.advertiseService("finish", &Fusion::finish, this);
  finish_spinner_.start();
  outputs_.advertise(guard.nh, status, guard.wrap(status.name(), [this] { connect(); }));
}

void Fusion::reconfigure(FusionConfig& config) {
  repair(config.mode, config_.mode,
         config.mode == "paper" || config.mode == "refined" || config.mode == "restored", "mode",
         "paper, refined or restored", status_);
  repair(config.bracket_mode, config_.bracket_mode,
         config.bracket_mode == "bracket" || config.bracket_mode == "sliding", "bracket_mode",
         "bracket or sliding", status_);
  repairNegative(config.max_held_frames, config_.max_held_frames, "max_held_frames", status_);
  repairNegative(config.bracket_size, config_.bracket_size, "bracket_size", status_);
  repairNegative(config.bracket_gap, config_.bracket_gap, "bracket_gap", status_);
  repairNegative(config.label_max_age, config_.label_max_age, "label_max_age", status_);
  repairNegative(config.label_timeout, config_.label_timeout, "label_timeout", status_);
  config_ = config;

  const FusionSettings settings{
      parseMode(config.mode), config.reference,     config.bracket_mode == "sliding",
      config.max_held_frames, config.label_max_age, config.label_timeout,
      restore_every_};
  frames_.configure({config.bracket_size, config.bracket_gap}, queue_size_);
  worker_.configure(settings);
  inputs_.needMeasured(settings.mode != Mode::kPaper);
}

// Works only while somebody listens.
void Fusion::connect() {
  const bool is_wanted = outputs_.wanted();
  if (is_wanted && !inputs_.subscribed()) {
    inputs_.subscribe();
  } else if (!is_wanted && inputs_.subscribed()) {
    inputs_.unsubscribe();
  }
}

bool Fusion::finish(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  std::future<int> finished = frames_.finish();
  const bool in_time = finished.wait_for(kFinishPatience) == std::future_status::ready;
  const int published = in_time ? finished.get() : -1;
  response.success = published >= 0;
  response.message =
      published >= 0 ? std::to_string(published) + " brackets published" : "the fusion did not end in time";
  return true;
}

using FusionNodelet = NodeletOf<Fusion>;

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::FusionNodelet, nodelet::Nodelet)
