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

#include "configured_nodelet.hpp"
#include "conversions.hpp"
#include "frame_queue.hpp"
#include "fusion_inputs.hpp"
#include "fusion_outputs.hpp"
#include "fusion_worker.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {
namespace {

constexpr const char* kProcessedTopic = "all_in_focus/processed";
constexpr std::chrono::seconds kFinishPatience(60);

}  // namespace

/// Fuses focus brackets into all-in-focus images: inputs -> queue -> worker -> outputs.
///
/// Callbacks run one after the other and only pass messages on. The service
/// ~finish waits for the worker, so it has a thread of its own.
class FusionNodelet : public ConfiguredNodelet<FusionConfig> {
 public:
  ~FusionNodelet() override;

 private:
  void onInit() override;
  void reconfigure(Config& config) override;
  void connect() override;
  bool finish(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  FusionOutputs outputs_;
  SceneCache scenes_;
  std::unique_ptr<FrameQueue> frames_;
  std::unique_ptr<FusionInputs> inputs_;
  std::unique_ptr<FusionWorker> worker_;
  ros::CallbackQueue finish_queue_;
  ros::ServiceServer finish_server_;
  std::unique_ptr<ros::AsyncSpinner> finish_spinner_;
  bool restore_every_ = false;
};

// A call of ~finish may be waiting for the queue; to stop the queue ends it. After that no callback needs the
// worker.
FusionNodelet::~FusionNodelet() {
  if (frames_) frames_->stop();
  finish_server_.shutdown();
  finish_spinner_.reset();
  if (guard_) guard_->stop();
  worker_.reset();
}

void FusionNodelet::onInit() {
  queue_size_ = 60;
  begin(kProcessedTopic);
  ros::NodeHandle& private_nh = getPrivateNodeHandle();
  restore_every_ = private_nh.param("restore_every_bracket", restore_every_);
  frames_ = std::make_unique<FrameQueue>(*monitor_, scenes_);
  inputs_ = std::make_unique<FusionInputs>(guard_->nh, private_nh, *monitor_, *guard_, scenes_, *frames_);
  worker_ = std::make_unique<FusionWorker>(
      *monitor_, *frames_, scenes_, [this](const FusedBracket& bracket) { outputs_.publish(bracket); });
  takeConfiguration();
  ros::NodeHandle finish_nh(private_nh);
  finish_nh.setCallbackQueue(&finish_queue_);
  finish_server_ = finish_nh.advertiseService("finish", &FusionNodelet::finish, this);
  finish_spinner_ = std::make_unique<ros::AsyncSpinner>(1, &finish_queue_);
  finish_spinner_->start();
  outputs_.advertise(guard_->nh, *monitor_, guard_->wrap(getName(), [this] { connect(); }));
  guard_->start();
}

void FusionNodelet::reconfigure(Config& config) {
  ConfigRepair repair;
  repair.checkOneOf(config.mode, config_.mode, {"paper", "refined", "restored"}, "mode");
  repair.checkNotNegative(config.max_held_frames, config_.max_held_frames, "max_held_frames");
  repair.checkOneOf(config.bracket_mode, config_.bracket_mode, {"bracket", "sliding"}, "bracket_mode");
  repair.checkNotNegative(config.bracket_size, config_.bracket_size, "bracket_size");
  repair.checkNotNegative(config.bracket_gap, config_.bracket_gap, "bracket_gap");
  repair.checkNotNegative(config.label_max_age, config_.label_max_age, "label_max_age");
  repair.checkNotNegative(config.label_timeout, config_.label_timeout, "label_timeout");
  if (!repair.warnings().empty()) monitor_->warn(repair.warnings());
  config_ = config;

  const FusionSettings settings{
      parseMode(config.mode), config.reference,     config.bracket_mode == "sliding",
      config.max_held_frames, config.label_max_age, config.label_timeout,
      restore_every_};
  frames_->configure({config.bracket_size, config.bracket_gap}, queue_size_);
  worker_->configure(settings);
  inputs_->needMeasured(settings.mode != Mode::kPaper);
}

// Works only while somebody listens.
void FusionNodelet::connect() {
  const bool is_wanted = outputs_.wanted();
  if (is_wanted && !inputs_->subscribed()) {
    inputs_->subscribe();
  } else if (!is_wanted && inputs_->subscribed()) {
    inputs_->unsubscribe();
  }
}

bool FusionNodelet::finish(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  std::future<int> finished = frames_->finish();
  const bool in_time = finished.wait_for(kFinishPatience) == std::future_status::ready;
  const int published = in_time ? finished.get() : -1;
  response.success = published >= 0;
  response.message =
      published >= 0 ? std::to_string(published) + " brackets published" : "the fusion did not end in time";
  return true;
}

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::FusionNodelet, nodelet::Nodelet)
