// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "scene_cache.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <chrono>
#include <iterator>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>
#include <set>
#include <stdexcept>

#include "image_limit.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

constexpr std::size_t kMaxCached = 64;  // stamps
constexpr std::size_t kMaxPinned = 64;  // brackets
constexpr std::size_t kMaxCachedBytes = kMaxWaitingBytes / 3;
constexpr double kTolerance = 1;  // s that a stamp may be ahead of the clock, or older than the one before
constexpr double kAssumedLatency = 30;  // s that frames may be late, before the first one came
constexpr double kLatencyMargin = 2;    // s more than the longest so far, afterwards
constexpr double kSilentTimeout = 0.1;  // s, for a topic of which the last wait brought nothing

}  // namespace

void SceneCache::addDepth(const sensor_msgs::ImageConstPtr& depth) {
  add(depth, &SceneMessages::depth, kDepth);
}

void SceneCache::addMeasured(const sensor_msgs::ImageConstPtr& measured) {
  add(measured, &SceneMessages::measured, kMeasured);
}

void SceneCache::addLabels(const sensor_msgs::ImageConstPtr& labels) {
  const bool is_whole =
      !labels->data.empty() && labels->data.size() >= std::size_t{labels->step} * labels->height;
  if (labels->encoding != sensor_msgs::image_encodings::TYPE_32SC1 || !is_whole)
    throw std::invalid_argument("labels must be 32SC1 and not empty, not " + labels->encoding);
  add(labels, &SceneMessages::labels, kLabels);
}

void SceneCache::add(const sensor_msgs::ImageConstPtr& image, Image as, Topic topic) {
  std::lock_guard<std::mutex> lock(mutex_);
  const ros::Time stamp = image->header.stamp;
  SceneMessages& entry = entries_[stamp];
  entry.stamp = stamp;
  entry.*as = image;
  for (Pinned& pinned : pinned_) update(pinned);
  update(at_work_);
  makeRoom();
  ros::Time& last = topics_[topic].last;
  if (stamp > last || secondsBetween(stamp, last) > kTolerance) last = stamp;
  arrived(topic);
}

// Holds mutex_.
void SceneCache::arrived(Topic topic) {
  topics_[topic].silent = false;
  changed_.notify_all();
}

void SceneCache::setCamera(const sensor_msgs::CameraInfoConstPtr& camera) {
  std::lock_guard<std::mutex> lock(mutex_);
  camera_ = camera;
  arrived(kCamera);
}

void SceneCache::setOptics(const OpticsConstPtr& optics) {
  std::lock_guard<std::mutex> lock(mutex_);
  optics_ = optics;
  arrived(kOptics);
}

void SceneCache::configure(bool by_labels, double max_age_s) {
  std::lock_guard<std::mutex> lock(mutex_);
  by_labels_ = by_labels;
  max_age_s_ = max_age_s;
}

void SceneCache::pin(const ros::Time& first_frame) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (pinnedFor(first_frame) != pinned_.end()) return;  // was announced, and begins
  // A bracket that lost the picture which was announced begins with a later one: its scene is kept already.
  Pinned own{first_frame, {}};
  for (const Pinned& before : pinned_) {
    const ros::Time& stamp = before.scene.stamp;
    const bool is_near = stamp <= first_frame && secondsBetween(stamp, first_frame) <= max_age_s_;
    if (is_near && stamp > own.scene.stamp) own.scene = before.scene;
  }
  update(own);
  pinned_.push_back(own);
  if (!entries_.empty())
    longest_latency_s_ = std::max(longest_latency_s_, secondsBetween(first_frame, entries_.rbegin()->first));
  makeRoom();
}

std::deque<SceneCache::Pinned>::iterator SceneCache::pinnedFor(const ros::Time& first_frame) {
  return std::find_if(pinned_.begin(), pinned_.end(),
                      [&](const Pinned& pinned) { return pinned.frame == first_frame; });
}

// Makes it the best scene for the frame so far, with the images of its stamp that have come since. A scene
// outlives its entry.
void SceneCache::update(Pinned& pinned) const {
  SceneMessages& scene = pinned.scene;
  const auto newest = newestAt(pinned.frame);
  if (newest != entries_.end() && newest->first > scene.stamp) scene = newest->second;
  const auto entry = entries_.find(scene.stamp);
  if (entry == entries_.end()) return;
  for (const Image image : {&SceneMessages::depth, &SceneMessages::measured, &SceneMessages::labels}) {
    if (entry->second.*image) scene.*image = entry->second.*image;
  }
}

void SceneCache::makeRoom() {
  while (pinned_.size() > kMaxPinned) pinned_.pop_front();
  while (entries_.size() > kMaxCached) entries_.erase(mostDispensable());
  // Images on which no pixel depends go first. The newest quarter stays complete.
  for (auto it = entries_.begin(); it != newestQuarter() && bytes() > kMaxCachedBytes; ++it) {
    SceneMessages& scene = it->second;
    if (by_labels_) {
      scene.depth = scene.measured = nullptr;
    } else {
      scene.labels = nullptr;
    }
  }
  while (entries_.size() > kFewestWaiting && bytes() > kMaxCachedBytes) entries_.erase(mostDispensable());
  while (pinned_.size() > kFewestWaiting && bytes() > kMaxWaitingBytes) pinned_.pop_front();
}

// Of all images. Scenes share them.
std::size_t SceneCache::bytes() const {
  std::set<sensor_msgs::ImageConstPtr> images;
  const auto count = [&](const SceneMessages& scene) {
    images.insert({scene.depth, scene.measured, scene.labels});
  };
  for (const auto& [stamp, entry] : entries_) count(entry);
  for (const Pinned& pinned : pinned_) count(pinned.scene);
  count(at_work_.scene);
  std::size_t bytes = 0;
  for (const sensor_msgs::ImageConstPtr& image : images) bytes += image ? image->data.size() : 0;
  return bytes;
}

SceneCache::Entries::iterator SceneCache::newestQuarter() {
  return std::prev(entries_.end(), static_cast<std::ptrdiff_t>((entries_.size() + 3) / 4));
}

// Of those before the newest quarter.
SceneCache::Entries::iterator SceneCache::mostDispensable() {
  const double latency = longest_latency_s_ > 0 ? longest_latency_s_ + kLatencyMargin : kAssumedLatency;
  const auto end = newestQuarter();
  const ros::Time newest = entries_.rbegin()->first;
  auto found = entries_.begin();
  double smallest_gap = std::numeric_limits<double>::infinity();
  for (auto it = entries_.begin(); it != end; ++it) {
    const bool too_old = secondsBetween(it->first, newest) > max_age_s_ + latency;
    if (too_old || !(it->second.*key())) return it;
    if (it == entries_.begin()) continue;
    const double gap = secondsBetween(std::prev(it)->first, std::next(it)->first);
    if (gap < smallest_gap) {
      smallest_gap = gap;
      found = it;
    }
  }
  return found;
}

// The scene for a frame, end() if there is none.
SceneCache::Entries::const_iterator SceneCache::newestAt(const ros::Time& frame) const {
  for (auto it = entries_.upper_bound(frame); it != entries_.begin();) {
    --it;
    if (secondsBetween(it->first, frame) > max_age_s_) break;
    if (it->second.*key()) return it;
  }
  return entries_.end();
}

// Whether no image with a stamp up to `stamp` can come any more. A topic keeps its order: none can once its
// last image is at or after `stamp`, unless that one is from before /clock jumped back.
bool SceneCache::isDecided(const Arrivals& topic, const ros::Time& stamp) {
  const ros::Time& last = topic.last;
  const ros::Time latest = std::max(stamp, ros::Time::now());
  return !last.isZero() && last >= stamp && secondsBetween(latest, last) < kTolerance;
}

void SceneCache::forgetAfter(const ros::Time& now) {
  std::lock_guard<std::mutex> lock(mutex_);
  entries_.erase(entries_.upper_bound(now), entries_.end());
  for (Arrivals& topic : topics_) {
    if (topic.last > now) topic.last = {};
  }
  changed_.notify_all();
}

void SceneCache::clear() {
  std::lock_guard<std::mutex> lock(mutex_);
  entries_.clear();
  pinned_.clear();
  at_work_ = {};
  is_awaited_ = false;
  camera_.reset();
  topics_ = {};
  changed_.notify_all();
}

SceneMessages SceneCache::await(const ros::Time& first_frame, double timeout_s) {
  const auto start = std::chrono::steady_clock::now();
  std::unique_lock<std::mutex> lock(mutex_);
  const auto own = pinnedFor(first_frame);
  at_work_ = own == pinned_.end() ? Pinned{first_frame, {}} : *own;
  // Older brackets were announced before it, but never came. Newer ones may come yet: it may have lost the
  // picture that was announced.
  if (own != pinned_.end()) {
    const auto is_over = [&](const Pinned& pinned) { return pinned.frame <= first_frame; };
    pinned_.erase(std::remove_if(pinned_.begin(), std::next(own), is_over), std::next(own));
  }
  is_awaited_ = true;
  update(at_work_);
  // stamp: waits until no better message for that stamp can come; without it, for any message.
  const auto wait = [&](Topic name, const auto message, const std::optional<ros::Time>& stamp) {
    Arrivals& topic = topics_[name];
    const auto is_there = [&] { return whole().*message != nullptr; };
    const std::chrono::duration<double> timeout(topic.silent ? std::min(timeout_s, kSilentTimeout)
                                                             : timeout_s);
    topic.silent = true;  // unless a message comes
    const bool in_time = changed_.wait_until(lock, start + timeout, [&] {
      // Not awaited: clear() was called.
      return !is_awaited_ || (stamp ? isDecided(topic, *stamp) : is_there());
    });
    if (in_time || is_there()) topic.silent = false;
  };
  if (by_labels_) {
    wait(kLabels, &SceneMessages::labels, first_frame);
  } else {
    wait(kDepth, &SceneMessages::depth, first_frame);
    if (at_work_.scene.depth) {
      wait(kMeasured, &SceneMessages::measured, at_work_.scene.stamp);
      wait(kCamera, &SceneMessages::camera, std::nullopt);
      wait(kOptics, &SceneMessages::optics, std::nullopt);
    }
  }
  is_awaited_ = false;
  at_work_.frame = at_work_.scene.stamp;  // it stays, whatever comes
  return whole();
}

SceneMessages SceneCache::current() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return whole();
}

// Holds mutex_. The scene at work with the newest camera and lens.
SceneMessages SceneCache::whole() const {
  SceneMessages scene = at_work_.scene;
  scene.camera = camera_;
  scene.optics = optics_;
  return scene;
}

std::string SceneCache::whyNone(const ros::Time& frame) const {
  std::lock_guard<std::mutex> lock(mutex_);
  const char* remedy = by_labels_ ? "(is the segmenter running?)" : "(is depth_preprocess running?)";
  const ros::Time *before = nullptr, *after = nullptr;
  for (const auto& [stamp, entry] : entries_) {
    if (!(entry.*key())) continue;
    if (stamp <= frame) before = &stamp;
    if (stamp > frame && !after) after = &stamp;
  }
  if (before) {
    return cv::format("the newest one before it is %.1f s older, more than label_max_age (%g s)",
                      secondsBetween(*before, frame), max_age_s_);
  }
  if (after)
    return cv::format("the oldest one in memory is %.1f s newer than it", secondsBetween(frame, *after));
  return std::string("none ever came ") + remedy;
}

}  // namespace all_in_focus
