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
#include <stdexcept>
#include <utility>

#include "image_limit.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {
namespace {

constexpr std::size_t kMaxCached = 64;                   // stamps
constexpr std::size_t kMaxBytes = kMaxWaitingBytes / 2;  // of all pinned scenes, and of all others
constexpr std::size_t kMaxPinned = 64;                   // brackets
constexpr double kTolerance = 1;  // s that a stamp may be ahead of the clock, or older than the one before
constexpr double kAssumedLatency = 30;  // s that frames may be late, before the first one came
constexpr double kLeastLatency = 5;     // s, afterwards
constexpr double kLatencyMargin = 1.25;
constexpr double kSilentTimeout = 0.1;  // s, for a topic of which the last wait brought nothing

std::size_t bytesOf(const SceneMessages& scene) {
  std::size_t bytes = 0;
  for (const auto* image : {&scene.depth, &scene.measured, &scene.labels}) {
    if (*image) bytes += (*image)->data.size();
  }
  return bytes;
}

// Labels are of use with the table of their regions only.
bool has(const SceneMessages& scene, sensor_msgs::ImageConstPtr SceneMessages::*image) {
  return scene.*image && (image != &SceneMessages::labels || scene.segments);
}

// Adds the messages that have come since.
void join(const SceneMessages& entry, SceneMessages& scene) {
  if (entry.depth) scene.depth = entry.depth;
  if (entry.measured) scene.measured = entry.measured;
  if (entry.labels) scene.labels = entry.labels;
  if (entry.segments) scene.segments = entry.segments;
}

}  // namespace

void SceneCache::addDepth(const sensor_msgs::ImageConstPtr& depth) {
  add(depth, &SceneMessages::depth, SceneTopic::kDepth);
}

void SceneCache::addMeasured(const sensor_msgs::ImageConstPtr& measured) {
  add(measured, &SceneMessages::measured, SceneTopic::kMeasured);
}

void SceneCache::addLabels(const sensor_msgs::ImageConstPtr& labels) {
  const bool is_whole =
      !labels->data.empty() && labels->data.size() >= std::size_t{labels->step} * labels->height;
  if (labels->encoding != sensor_msgs::image_encodings::TYPE_32SC1 || !is_whole)
    throw std::invalid_argument("labels must be 32SC1 and not empty, not " + labels->encoding);
  add(labels, &SceneMessages::labels, SceneTopic::kLabels);
}

void SceneCache::addSegments(const SegmentArrayConstPtr& segments) {
  add(segments, &SceneMessages::segments, SceneTopic::kLabels);
}

template <typename Message>
void SceneCache::add(const Message& message, Message SceneMessages::*as, SceneTopic topic) {
  std::lock_guard<std::mutex> lock(mutex_);
  SceneMessages& entry = entries_[message->header.stamp];
  entry.stamp = message->header.stamp;
  entry.*as = message;
  const bool is_whole = topic != SceneTopic::kLabels || has(entry, &SceneMessages::labels);
  updatePinned();
  makeRoom();
  if (!is_whole) return;
  ros::Time& last = (*this)[topic].last;
  if (entry.stamp > last || secondsBetween(entry.stamp, last) > kTolerance) last = entry.stamp;
  arrived(topic);
}

// Holds mutex_.
void SceneCache::arrived(SceneTopic topic) {
  (*this)[topic].silent = false;
  changed_.notify_all();
}

void SceneCache::setCamera(const sensor_msgs::CameraInfoConstPtr& camera) {
  std::lock_guard<std::mutex> lock(mutex_);
  camera_ = camera;
  arrived(SceneTopic::kCamera);
}

void SceneCache::setOptics(const OpticsConstPtr& optics) {
  std::lock_guard<std::mutex> lock(mutex_);
  optics_ = optics;
  arrived(SceneTopic::kOptics);
}

void SceneCache::configure(bool by_labels, double max_age_s) {
  std::lock_guard<std::mutex> lock(mutex_);
  by_labels_ = by_labels;
  max_age_s_ = max_age_s;
}

void SceneCache::setPublished(SceneTopic topic, bool published) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (std::exchange((*this)[topic].published, published) != published) changed_.notify_all();
}

void SceneCache::pin(const ros::Time& first_frame) {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto [found, is_new] = pinned_.try_emplace(first_frame);  // a bracket is announced, and begins later
  if (found->second.chosen) found->second = {};                   // but this is another one
  updatePinned();
  if (is_new && !entries_.empty())
    longest_latency_s_ = std::max(longest_latency_s_, secondsBetween(first_frame, entries_.rbegin()->first));
  makeRoom();
}

// A pinned scene outlives its entry.
void SceneCache::updatePinned() {
  for (auto& [frame, pinned] : pinned_) {
    const auto newest = pinned.chosen ? entries_.end() : newestAt(frame);
    if (newest != entries_.end() && newest->first > pinned.scene.stamp) pinned.scene = newest->second;
    const auto found = entries_.find(pinned.scene.stamp);
    if (found != entries_.end()) join(found->second, pinned.scene);
  }
}

void SceneCache::makeRoom() {
  std::size_t pinned_bytes = 0;
  for (const auto& [frame, pinned] : pinned_) pinned_bytes += bytesOf(pinned.scene);
  while (pinned_.size() > kMaxPinned || (pinned_bytes > kMaxBytes && pinned_.size() > kFewestWaiting)) {
    // The oldest one, whose bracket was dropped or never came, but not that of the bracket at work.
    const auto dispensable =
        std::min_element(pinned_.begin(), pinned_.end(),
                         [](const auto& a, const auto& b) { return a.second.at_work < b.second.at_work; });
    pinned_bytes -= bytesOf(dispensable->second.scene);
    pinned_.erase(dispensable);
  }
  const auto are_too_large = [this] {
    std::size_t bytes = 0;
    for (const auto& [stamp, entry] : entries_) bytes += bytesOf(entry);
    return bytes > kMaxBytes && entries_.size() > kFewestWaiting;
  };
  while (entries_.size() > kMaxCached || are_too_large()) {
    const auto newest_quarter = static_cast<std::ptrdiff_t>((entries_.size() + 3) / 4);
    const auto end = std::prev(entries_.end(), newest_quarter);  // that quarter stays complete
    const auto labelled =
        std::find_if(entries_.begin(), end, [](const auto& entry) { return entry.second.labels != nullptr; });
    if (entries_.size() > kMaxCached || by_labels_ || labelled == end) {
      entries_.erase(mostDispensable(end));
    } else {
      labelled->second.labels.reset();
      labelled->second.segments.reset();
    }
  }
}

// Of those before `end`.
SceneCache::Entries::iterator SceneCache::mostDispensable(Entries::iterator end) {
  const double latency =
      longest_latency_s_ > 0 ? std::max(kLeastLatency, kLatencyMargin * longest_latency_s_) : kAssumedLatency;
  const ros::Time newest = entries_.rbegin()->first;
  auto found = entries_.begin();
  double smallest_gap = std::numeric_limits<double>::infinity();
  for (auto it = entries_.begin(); it != end; ++it) {
    const bool too_old = secondsBetween(it->first, newest) > max_age_s_ + latency;
    if (too_old || !has(it->second, key())) return it;
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
    if (has(it->second, key())) return it;
  }
  return entries_.end();
}

SceneMessages SceneCache::sceneOf(const ros::Time& first_frame) const {
  const auto found = pinned_.find(first_frame);
  SceneMessages scene = found == pinned_.end() ? SceneMessages() : found->second.scene;
  if (!has(scene, &SceneMessages::labels)) {
    scene.labels.reset();
    scene.segments.reset();
  }
  scene.camera = camera_;
  scene.optics = optics_;
  return scene;
}

// Whether no image with a stamp up to `stamp` can come any more. A topic keeps its order: none can once its
// last image is at or after `stamp`, unless that one is from before /clock jumped back.
bool SceneCache::isDecided(const Topic& topic, const ros::Time& stamp) {
  const ros::Time& last = topic.last;
  const ros::Time latest = std::max(stamp, ros::Time::now());
  return !last.isZero() && last >= stamp && secondsBetween(latest, last) < kTolerance;
}

void SceneCache::forgetAfter(const ros::Time& now) {
  std::lock_guard<std::mutex> lock(mutex_);
  entries_.erase(entries_.upper_bound(now), entries_.end());
  for (Topic& topic : topics_) {
    if (topic.last > now) topic.last = {};
  }
  changed_.notify_all();
}

void SceneCache::clear() {
  std::lock_guard<std::mutex> lock(mutex_);
  entries_.clear();
  pinned_.clear();
  camera_.reset();
  topics_ = {};
  changed_.notify_all();
}

SceneMessages SceneCache::await(const ros::Time& first_frame, double timeout_s) {
  const auto start = std::chrono::steady_clock::now();
  std::unique_lock<std::mutex> lock(mutex_);
  const auto [own, is_new] = pinned_.try_emplace(first_frame);
  own->second.at_work = true;
  if (is_new) updatePinned();
  const auto scene = [&] { return sceneOf(first_frame); };
  // stamp: waits until no better message for that stamp can come; without it, for any message.
  const auto wait = [&](SceneTopic name, const auto message, const std::optional<ros::Time>& stamp) {
    Topic& topic = (*this)[name];
    const auto is_there = [&] { return scene().*message != nullptr; };
    const std::chrono::duration<double> timeout(topic.silent ? std::min(timeout_s, kSilentTimeout)
                                                             : timeout_s);
    topic.silent = true;  // unless a message comes
    const bool in_time = changed_.wait_until(lock, start + timeout, [&] {
      const bool forgotten = pinned_.count(first_frame) == 0;  // by clear(); the topic may be published again
      return forgotten || !topic.published || (stamp ? isDecided(topic, *stamp) : is_there());
    });
    if (in_time || is_there()) topic.silent = false;
  };
  if (by_labels_) {
    wait(SceneTopic::kLabels, &SceneMessages::labels, first_frame);
  } else {
    wait(SceneTopic::kDepth, &SceneMessages::depth, first_frame);
    if (scene().depth) {
      wait(SceneTopic::kMeasured, &SceneMessages::measured, scene().stamp);
      wait(SceneTopic::kCamera, &SceneMessages::camera, std::nullopt);
      wait(SceneTopic::kOptics, &SceneMessages::optics, std::nullopt);
    }
  }
  const auto found = pinned_.find(first_frame);
  if (found != pinned_.end()) found->second.chosen = true;
  return scene();
}

SceneMessages SceneCache::current(const ros::Time& first_frame) const {
  std::lock_guard<std::mutex> lock(mutex_);
  return sceneOf(first_frame);
}

// Brackets of older frames were announced, but never came. Where none is chosen, another bracket waits that
// has the same first frame, as in a bag that is played in a loop.
void SceneCache::release(const ros::Time& first_frame) {
  std::lock_guard<std::mutex> lock(mutex_);
  const auto own = pinned_.lower_bound(first_frame);
  const bool has_ended = own != pinned_.end() && own->first == first_frame && own->second.chosen;
  pinned_.erase(pinned_.begin(), has_ended ? std::next(own) : own);
}

std::string SceneCache::whyNone(const ros::Time& frame) const {
  std::lock_guard<std::mutex> lock(mutex_);
  const char* remedy = by_labels_ ? "(is the segmenter running?)" : "(is depth_preprocess running?)";
  const ros::Time *before = nullptr, *after = nullptr;
  for (const auto& [stamp, entry] : entries_) {
    if (!has(entry, key())) continue;
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
