// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/SegmentArray.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <condition_variable>
#include <map>
#include <mutex>

namespace all_in_focus {

/// A label image with the table of its regions.
struct LabelSet {
  sensor_msgs::ImageConstPtr labels;
  SegmentArrayConstPtr segments;
};

/// What is known of a scene besides the frames of its bracket. What is missing is null.
struct SceneMessages {
  LabelSet labels;
  sensor_msgs::ImageConstPtr depth;     ///< that the labels were cut from: registered, holes filled
  sensor_msgs::ImageConstPtr measured;  ///< the same before its holes were filled
  sensor_msgs::CameraInfoConstPtr camera;
  double focal_length_mm = 0;  ///< that the camera was calibrated with; 0 = unknown
};

/// Topics of the scene that somebody publishes.
struct SceneTopics {
  bool labels = false, depth = false, measured = false, camera = false;
};

/// The last seconds of what is known of the scene, to be found by stamp. Images are bounded by number and by
/// bytes. All methods are thread-safe.
class SceneCache {
 public:
  void addLabels(const LabelSet& set);
  void addDepth(const sensor_msgs::ImageConstPtr& depth);
  void addMeasured(const sensor_msgs::ImageConstPtr& measured);
  void setCamera(const sensor_msgs::CameraInfoConstPtr& camera);

  /// Only what somebody publishes is waited for.
  void expect(const SceneTopics& published);

  /// Time went back to `now`: what is newer is stale.
  void forgetAfter(const ros::Time& now);
  /// Forgets everything but the focal length, and lets go whoever waits.
  void clear();
  /// Nobody has to wait any more, ever.
  void close();

  /// The scene of a bracket: the label image with the newest stamp at or before the first frame, not older
  /// than max_age_s, and what has the stamp of that. Waits up to timeout_s for the labels, and with `whole`
  /// for all the rest too.
  SceneMessages await(const ros::Time& first_frame, double max_age_s, double timeout_s, bool whole);

  sensor_msgs::ImageConstPtr depthAt(const ros::Time& stamp) const;  ///< null: there is none
  sensor_msgs::CameraInfoConstPtr camera() const;                    ///< the newest one

 private:
  using Images = std::map<ros::Time, sensor_msgs::ImageConstPtr>;

  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::map<ros::Time, LabelSet> labels_;
  Images depths_, measured_;
  sensor_msgs::CameraInfoConstPtr camera_;
  double focal_length_mm_ = 0;  // of the first label image ever
  SceneTopics expected_;
  bool closed_ = false;
};

}  // namespace all_in_focus
