// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "scene_cache.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <limits>
#include <opencv2/core.hpp>

#include "image_limit.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

constexpr std::size_t kMaxCached = 64;  // stamps
constexpr double kClockTolerance = 1;   // s that a stamp may be ahead of the clock
constexpr double kAssumedLatency = 30;  // s that frames may be late, before the first one came
constexpr double kLeastLatency = 5;     // s, afterwards
constexpr double kLatencyMargin = 1.25;
constexpr double kSilentTimeout = 0.1;  // s, for a topic whose last wait was in vain

}  // namespace

void SceneCache::addLabels(const LabelSet& set) {
  std::lock_guard<std::mutex> lock(mutex_);
  const ros::Time stamp = set.labels->header.stamp;
  entries_[stamp].segments = set.segments;
  any_labels_ = true;
  const double focal_length_mm = set.segments->optics.focal_length_mm;
  if (focal_length_mm_ == 0 && std::isfinite(focal_length_mm) && focal_length_mm > 0)
    focal_length_mm_ = focal_length_mm;
  // Labels come in the order of stamps, so older depth images will get none.
  for (auto it = entries_.begin(); it->first < stamp;)
    it = it->second.labels ? std::next(it) : entries_.erase(it);
  add(set.labels, &Entry::labels, &SceneTopics::labels);
}

void SceneCache::addDepth(const sensor_msgs::ImageConstPtr& depth) {
  std::lock_guard<std::mutex> lock(mutex_);
  add(depth, &Entry::depth, &SceneTopics::depth);
}

void SceneCache::addMeasured(const sensor_msgs::ImageConstPtr& measured) {
  std::lock_guard<std::mutex> lock(mutex_);
  add(measured, &Entry::measured, &SceneTopics::measured);
}

// Holds mutex_.
void SceneCache::add(const sensor_msgs::ImageConstPtr& image, Image as, bool SceneTopics::*topic) {
  entries_[image->header.stamp].*as = image;
  silent_.*topic = false;
  makeRoom(imageLimit(kMaxCached, *image));
  changed_.notify_all();
}

void SceneCache::setCamera(const sensor_msgs::CameraInfoConstPtr& camera) {
  std::lock_guard<std::mutex> lock(mutex_);
  camera_ = camera;
  silent_.camera = false;
  changed_.notify_all();
}

void SceneCache::setMaxAge(double max_age_s) {
  std::lock_guard<std::mutex> lock(mutex_);
  max_age_s_ = max_age_s;
}

void SceneCache::expect(const SceneTopics& published) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (!closed_) expected_ = published;
  changed_.notify_all();
}

void SceneCache::pin(const ros::Time& first_frame) {
  std::lock_guard<std::mutex> lock(mutex_);
  pinned_.insert(first_frame);
  before_jump_.erase(first_frame);
  if (pinned_.size() > kMaxCached) pinned_.erase(pinned_.begin());
}

void SceneCache::frameArrived(const ros::Time& stamp) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (entries_.empty()) return;
  longest_latency_s_ = std::max(longest_latency_s_, secondsBetween(stamp, entries_.rbegin()->first));
}

void SceneCache::makeRoom(std::size_t most) {
  while (entries_.size() > most) drop(mostDispensable(most));
}

SceneCache::Entries::const_iterator SceneCache::mostDispensable(std::size_t most) const {
  std::set<ros::Time>
      needed;  // by the first pins, which are awaited first; the others must not fill the cache
  for (const ros::Time& frame : pinned_) {
    if (needed.size() >= most / 2) break;
    const auto labels = labelsFor(frame);
    if (labels != entries_.end()) needed.insert(labels->first);
  }
  const double latency =
      longest_latency_s_ > 0 ? std::max(kLeastLatency, kLatencyMargin * longest_latency_s_) : kAssumedLatency;
  const ros::Time newest = entries_.rbegin()->first;
  const auto end = std::prev(entries_.end(), static_cast<std::ptrdiff_t>(std::max<std::size_t>(1, most / 4)));

  auto found = entries_.end();
  double smallest_gap = std::numeric_limits<double>::infinity();
  for (auto it = entries_.begin(); it != end; ++it) {
    if (!it->second.labels || needed.count(it->first) > 0) continue;
    if (secondsBetween(it->first, newest) > max_age_s_ + latency) return it;
    if (it == entries_.begin()) continue;
    const double gap = secondsBetween(std::prev(it)->first, std::next(it)->first);
    if (gap < smallest_gap) {
      smallest_gap = gap;
      found = it;
    }
  }
  return found != entries_.end() ? found : entries_.begin();
}

void SceneCache::drop(Entries::const_iterator entry) {
  ros::Time& evicted = entry == entries_.begin() ? evicted_ : entries_.at(std::prev(entry)->first).evicted;
  evicted = std::max(evicted, entry->second.evicted);
  if (entry->second.labels) evicted = std::max(evicted, entry->first);
  entries_.erase(entry);
}

// Finds the entry with the newest labels at or before the frame.
SceneCache::Entries::const_iterator SceneCache::labelsFor(const ros::Time& frame) const {
  for (auto it = entries_.upper_bound(frame); it != entries_.begin();) {
    --it;
    if (it->second.labels) return it;
  }
  return entries_.end();
}

SceneCache::Entries::const_iterator SceneCache::labelsFor(const ros::Time& frame, double max_age_s) const {
  const auto found = labelsFor(frame);
  return found != entries_.end() && secondsBetween(found->first, frame) <= max_age_s ? found : entries_.end();
}

SceneMessages SceneCache::sceneAt(const ros::Time& stamp) const {
  SceneMessages scene;
  const auto found = entries_.find(stamp);
  if (found != entries_.end()) {
    scene.labels = {found->second.labels, found->second.segments};
    scene.depth = found->second.depth;
    scene.measured = found->second.measured;
  }
  scene.camera = camera_;
  scene.focal_length_mm = focal_length_mm_;
  return scene;
}

// Whether no newer message with a stamp up to `stamp` can come any more. That is so once a message at or
// after `stamp` has come, unless that message is from before /clock jumped back.
bool SceneCache::isDecided(const ros::Time& stamp, Image image) const {
  const ros::Time latest = std::max(stamp, ros::Time::now());
  const auto next = std::find_if(entries_.lower_bound(stamp), entries_.end(),
                                 [&](const auto& entry) { return entry.second.*image != nullptr; });
  return next != entries_.end() && secondsBetween(latest, next->first) < kClockTolerance;
}

void SceneCache::forgetAfter(const ros::Time& now) {
  std::lock_guard<std::mutex> lock(mutex_);
  before_jump_.clear();
  for (auto frame = pinned_.upper_bound(now); frame != pinned_.end(); ++frame) {
    const auto labels = labelsFor(*frame, max_age_s_);
    if (labels != entries_.end() && labels->first > now) before_jump_[*frame] = sceneAt(labels->first);
  }
  entries_.erase(entries_.upper_bound(now), entries_.end());
  pinned_.erase(pinned_.upper_bound(now), pinned_.end());
  evicted_ = ros::Time();
  for (auto& [stamp, entry] : entries_) entry.evicted = ros::Time();
  changed_.notify_all();
}

void SceneCache::clear() {
  std::lock_guard<std::mutex> lock(mutex_);
  entries_.clear();
  pinned_.clear();
  before_jump_.clear();
  camera_.reset();
  expected_ = silent_ = {};
  any_labels_ = false;
  evicted_ = ros::Time();
  changed_.notify_all();
}

void SceneCache::close() {
  std::lock_guard<std::mutex> lock(mutex_);
  closed_ = true;
  expected_ = {};
  changed_.notify_all();
}

SceneMessages SceneCache::await(const ros::Time& first_frame, double max_age_s, double timeout_s,
                                bool whole) {
  const auto seconds = [](double s) {
    return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(s));
  };
  const auto start = std::chrono::steady_clock::now();
  std::unique_lock<std::mutex> lock(mutex_);
  const auto isOfBeforeJump = [&] { return before_jump_.count(first_frame) > 0; };
  const auto wait = [&](bool SceneTopics::*topic, const auto& isThere) {
    const double timeout = silent_.*topic ? std::min(timeout_s, kSilentTimeout) : timeout_s;
    const bool there = changed_.wait_until(
        lock, start + seconds(timeout), [&] { return !(expected_.*topic) || isOfBeforeJump() || isThere(); });
    if (!there) silent_.*topic = true;
  };
  wait(&SceneTopics::labels, [&] { return isDecided(first_frame, &Entry::labels); });

  const auto labels = labelsFor(first_frame, max_age_s);
  const LabelSet chosen =
      labels != entries_.end() ? LabelSet{labels->second.labels, labels->second.segments} : LabelSet();
  const ros::Time stamp = chosen.labels ? labels->first : first_frame;
  if (whole && chosen.labels) {
    wait(&SceneTopics::depth, [&] { return isDecided(stamp, &Entry::depth); });
    wait(&SceneTopics::measured, [&] { return isDecided(stamp, &Entry::measured); });
    wait(&SceneTopics::camera, [&] { return camera_ != nullptr; });
  }
  if (isOfBeforeJump()) {
    SceneMessages scene = before_jump_.at(first_frame);
    before_jump_.erase(first_frame);
    return scene;
  }
  SceneMessages scene = sceneAt(stamp);
  scene.labels = chosen;
  if (!scene.labels.labels) scene.no_labels = whyNoLabels(first_frame, max_age_s);
  pinned_.erase(pinned_.begin(), pinned_.upper_bound(first_frame));
  return scene;
}

std::string SceneCache::whyNoLabels(const ros::Time& frame, double max_age_s) const {
  if (!expected_.labels && !any_labels_) return "nobody publishes them (is the segmenter running?)";
  if (!any_labels_) return "none ever came (is the segmenter running?)";
  const auto found = labelsFor(frame);
  const ros::Time evicted = found == entries_.end() ? evicted_ : found->second.evicted;
  if (!evicted.isZero() && secondsBetween(evicted, frame) <= max_age_s) {
    return cv::format("those of its time are no longer in memory, the frame came %.1f s late",
                      entries_.empty() ? 0.0 : secondsBetween(frame, entries_.rbegin()->first));
  }
  if (found != entries_.end()) {
    return cv::format("the newest one before it is %.1f s older, more than label_max_age (%g s)",
                      secondsBetween(found->first, frame), max_age_s);
  }
  for (const auto& [stamp, entry] : entries_) {
    if (entry.labels)
      return cv::format("the oldest one is %.1f s newer than it", secondsBetween(frame, stamp));
  }
  return "none came since time went back";
}

sensor_msgs::ImageConstPtr SceneCache::depthAt(const ros::Time& stamp) const {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = entries_.find(stamp);
  return found == entries_.end() ? nullptr : found->second.depth;
}

sensor_msgs::CameraInfoConstPtr SceneCache::camera() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return camera_;
}

}  // namespace all_in_focus
