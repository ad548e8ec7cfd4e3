// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "scene_cache.hpp"

#include <algorithm>
#include <chrono>

#include "config_repair.hpp"
#include "image_limit.hpp"

namespace all_in_focus {
namespace {

constexpr std::size_t kMaxCached = 64;  // images of a kind: two seconds of a Kinect
constexpr double kClockTolerance = 1;   // s that a stamp may be ahead of the clock

template <typename Value>
void insert(std::map<ros::Time, Value>& cache, const Value& value, const sensor_msgs::Image& image) {
  cache[image.header.stamp] = value;
  for (const std::size_t most = imageLimit(kMaxCached, image); cache.size() > most;)
    cache.erase(cache.begin());
}

template <typename Value>
void eraseAfter(std::map<ros::Time, Value>& cache, const ros::Time& now) {
  cache.erase(cache.upper_bound(now), cache.end());
}

template <typename Value>
Value at(const std::map<ros::Time, Value>& cache, const ros::Time& stamp) {
  const auto found = cache.find(stamp);
  return found == cache.end() ? Value() : found->second;
}

// Whether nothing can come any more that is newer, but not newer than `stamp`: once something at or after it
// has come, unless that is left from before /clock jumped back.
template <typename Value>
bool isDecided(const std::map<ros::Time, Value>& cache, const ros::Time& stamp) {
  const auto next = cache.lower_bound(stamp);
  const ros::Time latest = std::max(stamp, ros::Time::now()) + ros::Duration(kClockTolerance);
  return next != cache.end() && next->first < latest;
}

LabelSet newestOf(const std::map<ros::Time, LabelSet>& cache, const ros::Time& stamp, double max_age_s) {
  auto found = cache.upper_bound(stamp);
  if (found == cache.begin()) return {};
  --found;
  return (stamp - found->first).toSec() <= max_age_s ? found->second : LabelSet();
}

}  // namespace

void SceneCache::addLabels(const LabelSet& set) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    insert(labels_, set, *set.labels);
    const double focal_length_mm = set.segments->optics.focal_length_mm;
    if (focal_length_mm_ == 0 && ConfigRepair::isPositive(focal_length_mm))
      focal_length_mm_ = focal_length_mm;
  }
  changed_.notify_all();
}

void SceneCache::addDepth(const sensor_msgs::ImageConstPtr& depth) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    insert(depths_, depth, *depth);
  }
  changed_.notify_all();
}

void SceneCache::addMeasured(const sensor_msgs::ImageConstPtr& measured) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    insert(measured_, measured, *measured);
  }
  changed_.notify_all();
}

void SceneCache::setCamera(const sensor_msgs::CameraInfoConstPtr& camera) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    camera_ = camera;
  }
  changed_.notify_all();
}

void SceneCache::expect(const SceneTopics& published) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!closed_) expected_ = published;
  }
  changed_.notify_all();
}

void SceneCache::forgetAfter(const ros::Time& now) {
  std::lock_guard<std::mutex> lock(mutex_);
  eraseAfter(labels_, now);
  eraseAfter(depths_, now);
  eraseAfter(measured_, now);
}

void SceneCache::clear() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    labels_.clear();
    depths_.clear();
    measured_.clear();
    camera_.reset();
    expected_ = {};
  }
  changed_.notify_all();
}

void SceneCache::close() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
    expected_ = {};
  }
  changed_.notify_all();
}

SceneMessages SceneCache::await(const ros::Time& first_frame, double max_age_s, double timeout_s,
                                bool whole) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait_until(lock, deadline, [&] { return !expected_.labels || isDecided(labels_, first_frame); });
  SceneMessages scene;
  scene.labels = newestOf(labels_, first_frame, max_age_s);
  const ros::Time stamp = scene.labels.labels ? scene.labels.labels->header.stamp : first_frame;
  if (whole && scene.labels.labels) {
    changed_.wait_until(lock, deadline, [&] {
      return (!expected_.depth || isDecided(depths_, stamp)) &&
             (!expected_.measured || isDecided(measured_, stamp)) && (!expected_.camera || camera_);
    });
  }
  scene.depth = at(depths_, stamp);
  scene.measured = at(measured_, stamp);
  scene.camera = camera_;
  scene.focal_length_mm = focal_length_mm_;
  return scene;
}

sensor_msgs::ImageConstPtr SceneCache::depthAt(const ros::Time& stamp) const {
  std::lock_guard<std::mutex> lock(mutex_);
  return at(depths_, stamp);
}

sensor_msgs::CameraInfoConstPtr SceneCache::camera() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return camera_;
}

}  // namespace all_in_focus
