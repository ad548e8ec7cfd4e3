// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/bracket_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "alignment/alignment_parameters.hpp"

namespace all_in_focus::core {
namespace {

// Variance that a motion has even where all tiles agree, px^2.
double modelVariance(double radius, double tiles) {
  return std::pow(kAlignment.model_error * radius, 2) / std::max(kAlignment.fewest_tiles, tiles);
}

cv::Matx33d parallaxInformation(const PairMeasurement& found, double radius) {
  return (found.parallax_covariance + modelVariance(radius, found.tiles) * cv::Matx33d::eye()).inv();
}

}  // namespace

void BracketAlignment::begin(const cv::Size& size, const cv::Point2d& center, const Relief& relief,
                             bool drifts) {
  key_alignment_.setRelief(relief);
  other_alignment_.setRelief(relief);
  drift_alignment_.setRelief(relief);
  relief_ = relief;
  drifts_ = drifts && relief.isKnown();
  seen_ = foretold_ = turned_ = shifted_ = 0;
  size_ = size;
  center_ = center;
  radius_ = 0.5 * std::hypot(size.width, size.height);
  observations_.clear();
  shifts_.clear();
  scenes_ = 0;
  kept_.clear();
}

void BracketAlignment::observe(const cv::Mat& gray, int index) {
  current_ = {ImagePyramid(gray), {}};
  current_.frame.index = index;

  if (observations_.empty()) {
    current_.frame.scene = scenes_++;
    other_alignment_.setKey(current_.pyramid, center_);
    makeKey(current_);
  } else if (const PairMeasurement found = measureFromKey(); found.correlation >= kAlignment.same_scene) {
    current_.frame.scene = key_.scene;
    if (found.converged || !placeByOthers(/*measured=*/true)) place(found);
  } else if (!placeByOthers(/*measured=*/false)) {
    current_.frame.scene = scenes_++;
    observations_[index] = current_.frame;
    keep(current_);
    return;
  }
  observations_[index] = current_.frame;
  last_ = current_;
}

void BracketAlignment::reconsider(const cv::Mat& gray, int index, int reference) {
  const int scene = observations_.at(reference).scene;
  current_ = {ImagePyramid(gray), observations_.at(index)};
  const auto shows_scene = [scene](const Observation& frame) { return frame.scene == scene; };
  if (!placeByOneOf(views(shows_scene), /*measured=*/false)) return;
  observations_[index] = current_.frame;
  last_ = current_;
}

// The frame before and those that are kept, the latest first.
std::vector<const BracketAlignment::View*> BracketAlignment::views(
    const std::function<bool(const Observation&)>& wanted) const {
  std::vector<const View*> result;
  if (wanted(last_.frame)) result.push_back(&last_);
  for (auto kept = kept_.rbegin(); kept != kept_.rend(); ++kept) {
    if (wanted(kept->frame)) result.push_back(&*kept);
  }
  return result;
}

// Places the frame by another one than the key frame, if it fits one.
bool BracketAlignment::placeByOthers(bool measured) {
  return placeByOneOf(views([this](const Observation& frame) { return frame.index != key_.index; }),
                      measured);
}

// Places the frame by the first of the views from which its motion can be measured; measured = false: or else
// by the one that it is most like. The view becomes the key frame.
bool BracketAlignment::placeByOneOf(const std::vector<const View*>& views, bool measured) {
  const View* found = nullptr;
  PairMeasurement best;
  for (const View* view : views) {
    const PairMeasurement now = measureFrom(*view);
    if (now.correlation < kAlignment.same_scene) continue;
    if (now.converged || (!measured && (!found || now.correlation > best.correlation))) {
      found = view;
      best = now;
    }
    if (found && best.converged) break;
  }
  if (!found) return false;
  other_alignment_.setKey(found->pyramid, center_);
  makeKey(*found);
  place(best);
  if (last_.frame.scene != current_.frame.scene) keep(last_);  // that scene may return
  return true;
}

PairMeasurement BracketAlignment::measureFrom(const View& view) {
  other_alignment_.setKey(view.pyramid, center_);
  return other_alignment_.measure(current_.pyramid, {});
}

PairMeasurement BracketAlignment::measureFromKey() {
  const SimilarityTransform guess = compose(inverse(key_.motion), last_.frame.motion);
  PairMeasurement direct = key_alignment_.measure(current_.pyramid, {guess});
  const bool near = direct.converged &&
                    largestDisplacement(direct.motion, size_, center_) <= kAlignment.far_from_key * radius_;
  const bool usable = last_.frame.index != key_.index && last_.frame.measured;
  if (near || direct.correlation < kAlignment.same_scene || !usable) return direct;
  PairMeasurement step = measureFrom(last_);
  if (!step.converged) return direct;
  makeKey(last_);
  return step;
}

// The view's frame, which other_alignment_ has as its key, becomes the key frame.
void BracketAlignment::makeKey(const View& view) {
  std::swap(key_alignment_, other_alignment_);
  key_ = view.frame;
  key_.key_covariance += key_.covariance;
  key_.covariance = cv::Matx44d::zeros();
  observations_[key_.index] = key_;
  keep(view);
  kept_.back().frame = key_;
}

// Makes the view the latest of those that are kept.
void BracketAlignment::keep(const View& view) {
  const auto known = std::find_if(kept_.begin(), kept_.end(),
                                  [&](const View& kept) { return kept.frame.index == view.frame.index; });
  if (known != kept_.end()) {
    std::rotate(known, known + 1, kept_.end());
  } else {
    if (kept_.size() == kAlignment.most_keys) kept_.erase(kept_.begin());
    kept_.push_back(view);
  }
}

// Takes note of a pair whose parallax shows that the camera moved.
void BracketAlignment::noteParallax(const PairMeasurement& found) {
  if (!relief_.isKnown() || !isNoticeable({{}, {}, found.parallax})) return;
  const double squared = found.parallax.dot(parallaxInformation(found, radius_) * found.parallax);
  drifts_ = drifts_ || squared > std::pow(kAlignment.parallax_significance, 2);
}

// Where the camera turns, the shift of a frame tells how far: the corners move more than the middle by a part
// that is the same in all frames. What the mean depth shifts by a parallax is no turn.
void BracketAlignment::noteTurn(const PairMeasurement& found) {
  if (!found.converged) return;
  cv::Vec2d shift(found.motion.shift.x, found.motion.shift.y);
  if (relief_.isKnown())
    shift -= cv::Vec2d(found.parallax[0], found.parallax[1]) * (relief_.mean / relief_.deviation);
  const cv::Matx22d information =
      (found.turn_covariance + modelVariance(radius_, found.tiles) * cv::Matx22d::eye()).inv();
  turned_ += shift.dot(information * found.turn);
  shifted_ += shift.dot(information * shift);
}

// Where the camera moves sideways, the shift of a frame foretells its parallax; where it turns, there is next
// to none. Returns whether all frames measured against the reference so far show more than half of what is
// foretold.
bool BracketAlignment::parallaxFollows(const PairMeasurement& found) {
  const cv::Matx33d information = parallaxInformation(found, radius_);
  const cv::Point2d shift = found.motion.shift * (relief_.deviation / relief_.mean);
  const cv::Vec3d foretold(shift.x, shift.y, 0);
  seen_ += foretold.dot(information * found.parallax);
  foretold_ += foretold.dot(information * foretold);
  return seen_ > std::max(0.5 * foretold_, kAlignment.follow_significance * std::sqrt(foretold_));
}

double BracketAlignment::hiddenParallax(int reference, const std::function<bool(int)>& counts) const {
  const int scene = observations_.at(reference).scene;
  std::vector<const CellShifts*> pairs;
  for (const auto& [index, shifts] : shifts_) {
    if (observations_.at(index).scene == scene && counts(index)) pairs.push_back(&shifts);
  }
  return core::hiddenParallax(pairs, size_);
}

// Whether a point anywhere that is two standard deviations from the mean depth moves noticeably.
bool BracketAlignment::isNoticeable(const CameraMotion& motion) const {
  for (const int x : {0, size_.width - 1}) {
    for (const int y : {0, size_.height - 1}) {
      for (const double relief : {-2.0, 2.0}) {
        const cv::Point2d corner(x, y);
        if (cv::norm(motion.apply(corner, relief, center_, size_) - corner) >= kAlignment.noticeable)
          return true;
      }
    }
  }
  return false;
}

CameraMotion BracketAlignment::measureMotion(const cv::Mat& reference, const cv::Mat& gray,
                                             const Placement& placement) {
  if (!reference.empty()) {
    last_drift_ = {};
    drift_alignment_.setKey(ImagePyramid(reference), center_);
  }
  const double most_turn = turned_ + kAlignment.shift_significance * std::sqrt(shifted_);
  if (!relief_.isKnown() && cv::norm(placement.shift) * most_turn < kAlignment.noticeable * shifted_)
    return {placement};  // the frames so far tell that no turn would show here
  const ImagePyramid pyramid(gray);
  bool is_noted = false;
  // Where the camera has moved far, the pairs between or the frame before give a nearer start.
  for (const CameraMotion& start :
       {CameraMotion{placement}, {placement, {}, placement.parallax}, last_drift_}) {
    const PairMeasurement free =
        drift_alignment_.measure(pyramid, start, {/*turn=*/true, /*parallax=*/relief_.isKnown()});
    if (!free.converged && !relief_.isKnown()) break;
    if (!free.converged && !drifts_) continue;
    if (free.converged && !is_noted) {
      drifts_ = drifts_ || (relief_.isKnown() && parallaxFollows(free));
      // A turn before a wall that stands askew looks like a parallax.
      const bool tells = drifts_ || !relief_.isKnown();
      noteTurn(tells ? free : drift_alignment_.measure(pyramid, {placement}, {/*turn=*/true}));
      is_noted = true;
    }
    const bool turns = turned_ > kAlignment.shift_significance * std::sqrt(shifted_);
    const double turn_per_shift = turns ? turned_ / shifted_ : 0;
    if (drifts_) {
      const PairMeasurement found =
          drift_alignment_.measure(pyramid, {free.motion, {}, free.parallax}, {false, true, turn_per_shift});
      if (!found.converged || cv::trace(found.parallax_covariance) > std::pow(kAlignment.noticeable, 2))
        continue;
      last_drift_ = {found.motion, found.turn, found.parallax};
      return isNoticeable(last_drift_) ? last_drift_ : CameraMotion();
    }
    if (turn_per_shift * cv::norm(placement.shift) < kAlignment.noticeable) break;
    const PairMeasurement found =
        drift_alignment_.measure(pyramid, {placement}, {false, false, turn_per_shift});
    if (found.converged) return {found.motion, found.turn};
    break;
  }
  return {placement};
}

void BracketAlignment::place(const PairMeasurement& measurement) {
  Observation& frame = current_.frame;
  const int index = frame.index;
  if (!measurement.converged) frame = last_.frame.scene == key_.scene ? last_.frame : key_;
  frame.index = index;
  frame.measured = measurement.converged;
  if (!measurement.converged) return;
  noteParallax(measurement);
  if (!relief_.isKnown()) shifts_[index] = measurement.shifts;
  frame.scene = key_.scene;
  frame.motion = compose(key_.motion, measurement.motion);
  frame.parallax = key_.parallax + measurement.parallax;
  frame.key_covariance = key_.key_covariance;
  frame.covariance = measurement.covariance;
  frame.tiles = measurement.tiles;
}

Placement BracketAlignment::placement(int index, int reference) const {
  const Observation& to = observations_.at(index);
  const Observation& from = observations_.at(reference);
  Placement result;
  result.fits = to.scene == from.scene;
  result.measured = to.measured && result.fits;
  if (index == reference || !result.fits) return result;

  result.parallax = to.parallax - from.parallax;
  const SimilarityTransform measured = compose(inverse(from.motion), to.motion);
  const cv::Matx44d between_keys = to.key_covariance - from.key_covariance;
  cv::Matx44d covariance = to.covariance + from.covariance +
                           between_keys * (cv::trace(between_keys) < 0 ? -1.0 : 1.0) +
                           modelVariance(radius_, std::min(to.tiles, from.tiles)) * cv::Matx44d::eye();

  // The measured motion, pixels. Fixing one number moves the others by their correlation with it.
  cv::Vec4d found(radius_ * (measured.scale - 1), radius_ * measured.angle, measured.shift.x,
                  measured.shift.y);
  const auto significant = [&](int i) {
    return found[i] * found[i] > kAlignment.significance * kAlignment.significance * covariance(i, i);
  };
  const auto fix = [&](int i, double value) {
    cv::Vec4d slope;
    for (int k = 0; k < 4; ++k) slope[k] = covariance(k, i) / covariance(i, i);
    found += slope * (value - found[i]);
    covariance -= covariance(i, i) * slope * slope.t();
  };
  result.scale = significant(0) ? measured.scale : 1;
  fix(0, radius_ * (result.scale - 1));
  fix(1, significant(1) && std::abs(found[1]) > kAlignment.noticeable_roll ? found[1] : 0);
  result.angle = found[1] / radius_;
  const cv::Vec2d shift(found[2], found[3]);
  const cv::Matx22d shift_covariance = covariance.get_minor<2, 2>(2, 2);
  const double deviations = std::sqrt(shift.dot(shift_covariance.inv() * shift));
  if (deviations > kAlignment.shift_significance) result.shift = cv::Point2d(shift[0], shift[1]);

  if (largestDisplacement(result, size_, center_) < kAlignment.noticeable)
    static_cast<SimilarityTransform&>(result) = {};
  return result;
}

bool BracketAlignment::moves(int reference) const {
  return std::any_of(observations_.begin(), observations_.end(), [&](const auto& observation) {
    return !placement(observation.first, reference).isIdentity();
  });
}

}  // namespace all_in_focus::core
