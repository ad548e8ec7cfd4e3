// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <all_in_focus/FusionConfig.h>
#include <std_srvs/Trigger.h>

#include <boost/make_shared.hpp>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>

#include "conversions.hpp"
#include "fusion_inputs.hpp"
#include "fusion_outputs.hpp"
#include "fusion_worker.hpp"
#include "image_limit.hpp"
#include "nodelet_of.hpp"
#include "parameters.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {
namespace {

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

/// Fuses focus brackets into all-in-focus images: inputs -> worker -> outputs.
///
/// The quick callbacks only pass messages on. The worker and the service ~finish, which waits for it, share
/// the slow ones.
class Fusion {
 public:
  static constexpr const char* kProcessedTopic = "all_in_focus/processed";

  Fusion(CallbackGuard& guard, NodeStatus& status)
      : status_(status),
        outputs_(guard.quick.nh, status, guard.wrap(status.name(), [this] { connect(); })),
        worker_(guard, status, scenes_, outputs_),
        inputs_(guard, status, scenes_, worker_) {
    readNumber(guard.slow.private_nh, "queue_size", 1, kMostWaiting, at_start_.most_waiting, status);
    readParameter(guard.slow.private_nh, "restore_every_bracket", at_start_.restore_every, status);
    at_start_.calibration = readCalibration(guard.slow.private_nh, status);
    configuration_ = serveConfiguration<FusionConfig>(guard.quick.private_nh, guard, status,
                                                      [this](auto& config) { reconfigure(config); });
    finish_server_ = guard.slow.private_nh.advertiseService("finish", &Fusion::finish, this);
    guard.on_stop = [this] { inputs_.unsubscribe(); };
  }

 private:
  void reconfigure(FusionConfig& config) {
    repairName(config.mode, config_.mode, parseMode, status_);
    repair(config.bracket_mode, config_.bracket_mode,
           config.bracket_mode == "bracket" || config.bracket_mode == "sliding", "bracket_mode",
           "bracket or sliding", status_);
    repairNegative(config.max_held_frames, config_.max_held_frames, "max_held_frames", status_);
    repairNegative(config.bracket_size, config_.bracket_size, "bracket_size", status_);
    repairNegative(config.bracket_gap, config_.bracket_gap, "bracket_gap", status_);
    repairNegative(config.label_max_age, config_.label_max_age, "label_max_age", status_);
    repairNegative(config.label_timeout, config_.label_timeout, "label_timeout", status_);
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
    inputs_.configure(config.bracket_gap);
    outputs_.setMode(settings.bracket.mode);
    connect();  // who listened to nothing but an output that went is gone
  }

  // Works only while somebody listens.
  void connect() {
    const bool is_wanted = outputs_.wanted();
    if (is_wanted && !inputs_.subscribed()) {
      inputs_.subscribe();
    } else if (!is_wanted && inputs_.subscribed()) {
      inputs_.unsubscribe();
    }
  }

  bool finish(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
    const int published = worker_.finish();
    response.success = published >= 0;
    response.message =
        published >= 0 ? std::to_string(published) + " brackets published" : "nobody listens any more";
    return true;
  }

  NodeStatus& status_;
  FusionSettings at_start_;                               // what reconfigure() does not change
  FusionConfig config_ = FusionConfig::__getDefault__();  // always possible
  FusionOutputs outputs_;
  SceneCache scenes_;
  FusionWorker worker_;
  FusionInputs inputs_;
  ros::ServiceServer finish_server_;
  std::unique_ptr<dynamic_reconfigure::Server<FusionConfig>> configuration_;
};

using FusionNodelet = NodeletOf<Fusion>;

}  // namespace all_in_focus

PLUGINLIB_EXPORT_CLASS(all_in_focus::FusionNodelet, nodelet::Nodelet)
