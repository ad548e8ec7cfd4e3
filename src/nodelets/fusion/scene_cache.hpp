// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/Optics.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <map>
#include <mutex>
#include <string>

namespace all_in_focus {

/// The messages about a scene besides the frames of its bracket. A missing one is null. The images have one
/// stamp.
struct SceneMessages {
  ros::Time stamp;
  sensor_msgs::ImageConstPtr depth;     ///< registered, holes filled
  sensor_msgs::ImageConstPtr measured;  ///< the same before its holes were filled
  sensor_msgs::ImageConstPtr labels;    ///< cut from the depth
  sensor_msgs::CameraInfoConstPtr camera;
  OpticsConstPtr optics;
};

/// Keeps the messages about the scene until a frame with their stamp comes. That may be much later: a camera
/// sends a picture after its download and the next move of focus, at worst 20 s after the shutter.
///
/// The scene of a bracket is that of the newest depth at or before its first frame; in mode paper that of the
/// newest labels. What has the same stamp belongs to it. Camera and lens are the newest ones.
///
/// Scenes are limited in number and bytes. Those of no bracket go first: of the older ones the images on
/// which no pixel depends (labels; in mode paper depth), then those whose neighbours are nearest in time, so
/// that the whole time that a frame may be late stays covered. With the scenes that are kept for brackets
/// there may be three times as many bytes; then the oldest of these go. All methods are thread-safe.
class SceneCache {
 public:
  void addDepth(const sensor_msgs::ImageConstPtr& depth);
  void addMeasured(const sensor_msgs::ImageConstPtr& measured);
  /// Throws std::invalid_argument for what is no whole 32SC1 image.
  void addLabels(const sensor_msgs::ImageConstPtr& labels);
  void setCamera(const sensor_msgs::CameraInfoConstPtr& camera);
  void setOptics(const OpticsConstPtr& optics);

  /// by_labels: mode paper. max_age_s: how much older than a frame its scene may be.
  void configure(bool by_labels, double max_age_s);

  /// Call when a bracket begins or is announced: its scene is kept until await(), whatever comes later. How
  /// much later than its first frame that is tells how long scenes are kept.
  void pin(const ros::Time& first_frame);

  /// Call when time went back to `now`: drops what is newer. Scenes of brackets stay.
  void forgetAfter(const ros::Time& now);
  /// Forgets everything but the lens, and ends a wait.
  void clear();

  /// The scene of a bracket, which takes the place of that of the bracket before. Waits up to timeout_s until
  /// no better one can come, and until it is complete. After a wait that brought nothing of a topic the next
  /// waits are short, until one of its messages comes.
  SceneMessages await(const ros::Time& first_frame, double timeout_s);
  /// The same scene with the images that have joined it since.
  SceneMessages current() const;

  /// Why a frame has no scene, as text for people.
  std::string whyNone(const ros::Time& frame) const;

 private:
  using Entries = std::map<ros::Time, SceneMessages>;  // without camera and lens
  using Image = sensor_msgs::ImageConstPtr SceneMessages::*;
  struct Pinned {
    ros::Time frame;      // it wants the scene of that time
    SceneMessages scene;  // the best one so far
  };
  enum Topic { kDepth, kMeasured, kLabels, kCamera, kOptics, kTopics };
  struct Arrivals {
    bool silent = false;  // the last wait brought nothing
    ros::Time last;       // stamp of the last image, small disorder aside; 0: none
  };

  void add(const sensor_msgs::ImageConstPtr& image, Image as, Topic topic);
  void arrived(Topic topic);
  std::deque<Pinned>::iterator pinnedFor(const ros::Time& first_frame);
  void update(Pinned& pinned) const;
  void makeRoom();
  std::size_t bytes() const;
  Entries::iterator newestQuarter();
  Entries::iterator mostDispensable();
  Entries::const_iterator newestAt(const ros::Time& frame) const;
  SceneMessages whole() const;
  Image key() const { return by_labels_ ? &SceneMessages::labels : &SceneMessages::depth; }
  static bool isDecided(const Arrivals& topic, const ros::Time& stamp);

  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  Entries entries_;
  std::deque<Pinned> pinned_;  // for brackets to come, in their order
  Pinned at_work_;             // of the bracket that waits for it or is fused
  bool is_awaited_ = false;    // it waits
  std::array<Arrivals, kTopics> topics_;
  bool by_labels_ = false;
  double max_age_s_ = 1, longest_latency_s_ = 0;
  sensor_msgs::CameraInfoConstPtr camera_;
  OpticsConstPtr optics_;
};

}  // namespace all_in_focus
