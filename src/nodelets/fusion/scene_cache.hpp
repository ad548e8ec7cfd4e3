// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/SegmentArray.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <condition_variable>
#include <map>
#include <mutex>
#include <opencv2/core.hpp>
#include <set>
#include <string>

namespace all_in_focus {

/// A label image with the table of its regions.
struct LabelSet {
  sensor_msgs::ImageConstPtr labels;
  SegmentArrayConstPtr segments;
};

/// The messages about a scene besides the frames of its bracket. A missing one is null.
struct SceneMessages {
  LabelSet labels;
  sensor_msgs::ImageConstPtr depth;     ///< that the labels were cut from: registered, holes filled
  sensor_msgs::ImageConstPtr measured;  ///< the same before its holes were filled
  sensor_msgs::CameraInfoConstPtr camera;
  cv::Size frame_size;         ///< of the bracket
  double focal_length_mm = 0;  ///< that the camera was calibrated with; 0 = unknown
  std::string no_labels;       ///< the reason why there are no labels, as text for people
};

/// Topics of the scene that somebody publishes.
struct SceneTopics {
  bool labels = false, depth = false, measured = false, camera = false;
};

/// Keeps the messages about the scene until a frame with their stamp comes. That may be much later: a camera
/// sends a picture after its download and the next move of focus, at worst 20 s after the shutter.
///
/// Labels, depth and measured depth of one stamp are kept and dropped together, limited in number and bytes.
/// At the limit it keeps the newest images and those that a pinned frame needs. Of the older images it drops
/// those whose neighbours are nearest in time, so that the whole time that a frame may be late stays covered.
/// All methods are thread-safe.
class SceneCache {
 public:
  void addLabels(const LabelSet& set);
  void addDepth(const sensor_msgs::ImageConstPtr& depth);
  void addMeasured(const sensor_msgs::ImageConstPtr& measured);
  void setCamera(const sensor_msgs::CameraInfoConstPtr& camera);

  /// How much older than a frame its labels may be.
  void setMaxAge(double max_age_s);
  /// Tells which topics are published; await() waits for these only.
  void expect(const SceneTopics& published);

  /// Call when a bracket begins: its scene is kept, whatever comes later, until await() has returned it.
  void pin(const ros::Time& first_frame);
  /// Call when a frame has arrived, to measure how late frames are.
  void frameArrived(const ros::Time& stamp);

  /// Call when time went back to `now`: drops what is newer. The scenes of brackets that have begun stay for
  /// await().
  void forgetAfter(const ros::Time& now);
  /// Forgets everything but the focal length, and ends all waits.
  void clear();
  /// Ends all waits, also later ones.
  void close();

  /// The scene of a bracket: the label image with the newest stamp at or before the first frame, not older
  /// than max_age_s, and what has the stamp of that. Waits up to timeout_s for the labels, and with `whole`
  /// for all the rest too. After a wait in vain for a topic the next waits are short, until one of its
  /// messages comes.
  SceneMessages await(const ros::Time& first_frame, double max_age_s, double timeout_s, bool whole);

  sensor_msgs::ImageConstPtr depthAt(const ros::Time& stamp) const;  ///< null: there is none
  sensor_msgs::CameraInfoConstPtr camera() const;                    ///< the newest one

 private:
  struct Entry {
    sensor_msgs::ImageConstPtr labels, depth, measured;
    SegmentArrayConstPtr segments;  // of the labels
    ros::Time evicted;              // newest labels that were dropped between this and the next entry
  };
  using Entries = std::map<ros::Time, Entry>;
  using Image = sensor_msgs::ImageConstPtr Entry::*;  // one of its three

  void add(const sensor_msgs::ImageConstPtr& image, Image as, bool SceneTopics::*topic);
  void makeRoom(std::size_t most);
  Entries::const_iterator mostDispensable(std::size_t most) const;
  void drop(Entries::const_iterator entry);
  Entries::const_iterator labelsFor(const ros::Time& frame) const;
  Entries::const_iterator labelsFor(const ros::Time& frame, double max_age_s) const;
  SceneMessages sceneAt(const ros::Time& stamp) const;
  bool isDecided(const ros::Time& stamp, Image image) const;
  std::string whyNoLabels(const ros::Time& frame, double max_age_s) const;

  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  Entries entries_;
  std::set<ros::Time> pinned_;                      // stamps of frames
  std::map<ros::Time, SceneMessages> before_jump_;  // of pinned frames
  double max_age_s_ = 1, longest_latency_s_ = 0;
  bool any_labels_ = false;
  ros::Time evicted_;  // as in an entry, before the first one
  sensor_msgs::CameraInfoConstPtr camera_;
  double focal_length_mm_ = 0;  // of the first label image ever
  SceneTopics expected_, silent_;
  bool closed_ = false;
};

}  // namespace all_in_focus
