// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/Optics.h>
#include <all_in_focus/SegmentArray.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <condition_variable>
#include <cstddef>
#include <map>
#include <mutex>
#include <string>

namespace all_in_focus {

/// The messages about a scene besides the frames of its bracket. A missing one is null. The images and the
/// table of the regions have one stamp.
struct SceneMessages {
  ros::Time stamp;
  sensor_msgs::ImageConstPtr depth;     ///< registered, holes filled
  sensor_msgs::ImageConstPtr measured;  ///< the same before its holes were filled
  sensor_msgs::ImageConstPtr labels;    ///< cut from the depth
  SegmentArrayConstPtr segments;        ///< of the labels
  sensor_msgs::CameraInfoConstPtr camera;
  OpticsConstPtr optics;
};

/// The topics of a scene.
enum class SceneTopic { kDepth, kMeasured, kLabels, kCamera, kOptics };
constexpr std::size_t kSceneTopics = 5;

/// Keeps the messages about the scene until a frame with their stamp comes. That may be much later: a camera
/// sends a picture after its download and the next move of focus, at worst 20 s after the shutter.
///
/// The scene of a bracket is that of the newest depth at or before its first frame; in mode paper that of the
/// newest labels. What has the same stamp belongs to it. Camera and lens are the newest ones.
///
/// Scenes are limited in number and bytes, and so are those that are kept for brackets: at the limit the
/// oldest of these go, whose bracket was dropped or never came. Of the others the labels of older ones go
/// first, unless they choose the scene: only a report needs them. Then, of the older scenes, those go whose
/// neighbours are nearest in time, so that the whole time that a frame may be late stays covered. All methods
/// are thread-safe.
class SceneCache {
 public:
  void addDepth(const sensor_msgs::ImageConstPtr& depth);
  void addMeasured(const sensor_msgs::ImageConstPtr& measured);
  /// They count together with their segments. Throws std::invalid_argument for what is no whole 32SC1 image.
  void addLabels(const sensor_msgs::ImageConstPtr& labels);
  void addSegments(const SegmentArrayConstPtr& segments);
  void setCamera(const sensor_msgs::CameraInfoConstPtr& camera);
  void setOptics(const OpticsConstPtr& optics);

  /// by_labels: mode paper. max_age_s: how much older than a frame its scene may be.
  void configure(bool by_labels, double max_age_s);
  /// Tells whether a topic is published; await() waits for these only.
  void setPublished(SceneTopic topic, bool published);

  /// Call when a bracket begins or is announced: its scene is kept, whatever comes later, until release().
  /// How much later than its first frame that is tells how long scenes are kept.
  void pin(const ros::Time& first_frame);

  /// Call when time went back to `now`: drops what is newer. Pinned scenes stay.
  void forgetAfter(const ros::Time& now);
  /// Forgets everything but the lens, also what is published, and ends all waits.
  void clear();

  /// The scene of a bracket. Waits up to timeout_s until no better one can come, and until it is complete.
  /// After a wait that brought nothing of a topic the next waits are short, until one of its messages comes.
  SceneMessages await(const ros::Time& first_frame, double timeout_s);

  /// The same scene with the images that have joined it since, until release().
  SceneMessages current(const ros::Time& first_frame) const;
  /// Call when a bracket has ended.
  void release(const ros::Time& first_frame);

  /// Why a frame has no scene, as text for people.
  std::string whyNone(const ros::Time& frame) const;

 private:
  using Entries = std::map<ros::Time, SceneMessages>;  // without camera and lens
  struct Pinned {
    SceneMessages scene;   // the best one so far
    bool at_work = false;  // its bracket waits for it, or is fused
    bool chosen = false;   // no other one will do any more
  };
  using Image = sensor_msgs::ImageConstPtr SceneMessages::*;

  template <typename Message>
  void add(const Message& message, Message SceneMessages::*as, SceneTopic topic);
  void arrived(SceneTopic topic);
  void updatePinned();
  void makeRoom();
  Entries::iterator mostDispensable(Entries::iterator end);
  Entries::const_iterator newestAt(const ros::Time& frame) const;
  SceneMessages sceneOf(const ros::Time& first_frame) const;
  Image key() const { return by_labels_ ? &SceneMessages::labels : &SceneMessages::depth; }

  struct Topic {
    bool published = false;
    bool silent = false;  // the last wait brought nothing
    ros::Time last;       // stamp of the last image, small disorder aside; 0: none
  };
  static bool isDecided(const Topic& topic, const ros::Time& stamp);
  Topic& operator[](SceneTopic topic) { return topics_[static_cast<std::size_t>(topic)]; }

  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  Entries entries_;
  std::map<ros::Time, Pinned> pinned_;  // by first frame
  std::array<Topic, kSceneTopics> topics_;
  bool by_labels_ = false;
  double max_age_s_ = 1, longest_latency_s_ = 0;
  sensor_msgs::CameraInfoConstPtr camera_;
  OpticsConstPtr optics_;
};

}  // namespace all_in_focus
