// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/refined_fusion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "alignment/alignment_parameters.hpp"
#include "all_in_focus/codes.hpp"
#include "fusion/camera_curve.hpp"
#include "fusion/clipped_lights.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

// At most so many frames are held until the reference comes: the first one and the latest ones. Some may show
// another scene.
constexpr size_t kMostHeld = 4;

// Light of a frame over that of the reference which exposure matching makes equal, with a margin because both
// measure.
constexpr double kMostLight = 1.1 * ExposureMatching::kLargestGain;

// Whether two frames may be compared for their noise. Neighbours differ least in blur and motion. But the
// codec of a video copies noise from frame to frame, so where frames are many, some must lie between.
bool areApart(int index, int earlier) {
  return index - earlier > index / 16;
}

// What a kernel of a warp reaches no transparent pixel from.
cv::Mat clear(const cv::Mat& opaque) {
  cv::Mat out;
  cv::erode(opaque, out, cv::Mat::ones(9, 9, CV_8UC1));
  return out;
}

// Leaves transparent pixels less than the least share that counts.
void hide(const std::uint8_t* opaque, int n, float* sharpness) {
  constexpr float kNothing = 1e-6f;
  for (int x = 0; x < n; ++x) sharpness[x] *= opaque[x] != 0 ? 1 : kNothing;
}

// The factor by which a LUT of gray levels changes the contrast of middle gray.
double contrastGain(const std::array<float, 256>& lut) {
  return (lut[192] - lut[64]) / 128.0;
}

}  // namespace

void RefinedFusion::begin(const BracketScene& scene, const RefinedConfig& config, const cv::Size& size) {
  if (scene.camera) validate(*scene.camera, "colour camera");
  config_ = config;
  size_ = size;
  reference_ = -1;
  focal_length_mm_ = scene.camera ? scene.optics.focal_length_mm : 0;
  center_ = {(size.width - 1) / 2.0, (size.height - 1) / 2.0};
  double pixel_pitch_mm = 0;
  if (scene.camera) {
    // The camera may have been calibrated at another resolution.
    const double scale = static_cast<double>(size.width) / scene.camera->size.width;
    center_ = {(scene.camera->cx + 0.5) * scale - 0.5, (scene.camera->cy + 0.5) * scale - 0.5};
    pixel_pitch_mm = scene.calibratedPitch() / scale;
  }
  lens_ = {};
  predicted_.release();
  lights_.release();
  focus_known_ = false;
  noise_ = {};
  linear_ = false;
  held_.clear();
  light_.clear();
  predicts_ = config.prediction && !scene.depth.empty() && pixel_pitch_mm > 0;
  if (predicts_) {
    prediction_ = DefocusPrediction();
    prediction_.begin(scene.depth, scene.measured, size, scene.optics, pixel_pitch_mm);
    // Windows of this level and of coarser ones reach farther than depth edges are uncertain.
    const size_t level = std::max<size_t>(prediction_.textureLevel(), 2) - 1;
    predicted_ = prediction_.known(SharpnessPyramid::levelSize(size, level));
    lens_.begin(scene, pixel_pitch_mm, size, center_);
  }
  focal_px_ = scene.camera ? scene.camera->fx * size.width / scene.camera->size.width : 0;
  moved_mm_ = turned_ = 0;
  relief_image_.release();
  relief_ = config.alignment ? reliefOf(scene.depth, scene.measured) : Relief();
  alignment_.begin(size, center_, relief_);
}

// Corrects the prediction, or gives it up, where the frames up to the reference contradict f-number and focus
// distances. They do not tell while the camera moves: parallax looks like another blur.
void RefinedFusion::checkLens() {
  if (!predicts_ || alignment_.drifts()) return;
  lens_.ask(linear_ ? LightCurve::linear() : LightCurve::srgb(), [this](int index) {
    return config_.alignment ? alignment_.placement(index, reference_) : Placement();
  });
  predicts_ = lens_.mayPredict();
  if (!predicts_) predicted_.release();
  prediction_.setAperture(lens_.aperture());
}

void RefinedFusion::observe(const cv::Mat& gray, int index, double focus_mm) {
  if (focus_mm <= focal_length_mm_) {
    throw std::invalid_argument(
        cv::format("fusion: frame %d is focused at %g mm, not beyond the focal length, %g mm", index,
                   focus_mm, focal_length_mm_));
  }
  focus_known_ = focus_known_ || !std::isnan(focus_mm);
  light_.observe(gray, index);
  if (config_.alignment) alignment_.observe(gray, index, light_.isOdd(index, kMostLight));
  const bool is_behind = reference_ >= 0;
  if (predicts_ && !std::isnan(focus_mm)) lens_.observe(is_behind ? cv::Mat() : gray, index, focus_mm);
  if (is_behind) return;
  if (!held_.empty() && !areApart(index, held_.front().index)) return;
  const bool is_full = held_.size() == kMostHeld;
  if (!is_full) held_.emplace_back();
  const auto spare = held_.end() - (is_full ? 2 : 1);  // the first frame stays
  std::rotate(held_.begin(), spare, spare + 1);
  held_.front().index = index;
  gray.copyTo(held_.front().gray);
}

// Measures the noise of the reference and finds the camera's curve, by earlier frames. One that does not fit,
// or a copy of the reference, does not count.
void RefinedFusion::compareWithEarlier(const cv::Mat& reference) {
  std::vector<cv::Mat> others;  // the nearest first
  bool has_first = false;
  for (const HeldFrame& held : held_) {
    if (!areApart(reference_, held.index) || cv::norm(held.gray, reference, cv::NORM_INF) == 0) continue;
    if (!misfit(held.index, reference_).empty()) continue;
    others.push_back(held.gray);
    has_first = &held == &held_.back();
  }
  linear_ = hasLinearCodes(reference, others);
  if (!config_.noise) return;
  // The lowest noise counts: against the nearest frame, which differs least in blur and motion, and the
  // first.
  std::vector<cv::Mat> compared;
  if (!others.empty()) compared.push_back(others.front());
  if (has_first && others.size() > 1) compared.push_back(others.back());
  noise_ = NoiseSpectrum::of(reference, std::move(compared));
}

// Whether the frame was taken from another place than the one before it: then all of it has changed.
bool RefinedFusion::hasMoved(int index) const {
  const auto here = light_.frames().find(index);
  if (here == light_.frames().begin()) return false;
  const Placement placement = alignment_.placement(index, std::prev(here)->first);
  const double radius = 0.5 * std::hypot(size_.width, size_.height);
  return placement.measured && largestDisplacement(placement, size_, center_) > kSmallShift * radius;
}

// Says of a frame whether it fits.
std::function<bool(int)> RefinedFusion::fitting(int reference) const {
  return [this, reference](int other) { return alignment_.placement(other, reference).fits; };
}

std::string RefinedFusion::misfit(int index, int reference) const {
  const double light = config_.exposure ? light_.jump(index, reference, kMostLight) : 1;
  if (light != 1) {
    return cv::format("it is much %s than the others (%.2g times their light)",
                      light > 1 ? "brighter" : "darker", light);
  }
  if (!config_.alignment) return "";
  const Placement placement = alignment_.placement(index, reference);
  std::string reason = "it shows something else than the others";
  if (placement.fits) {
    const double intrusion = hasMoved(index) ? 0 : light_.intrusion(index, fitting(reference));
    if (intrusion == 0) return "";
    return reason + cv::format(" in %.0f %% of the picture", 100 * intrusion) +
           ": something passed by, or the camera was moved";
  }
  if (!std::isnan(placement.correlation)) {
    reason += cv::format(" (correlation %.2f, below %.2f)", placement.correlation, kAlignment.same_scene);
  }
  return reason + ": another scene, or the camera was moved";
}

FrameGroup RefinedFusion::largestGroup() const {
  const auto displacement = [this](int index, int earlier) {
    if (!config_.alignment) return 0.0;
    const Placement placement = alignment_.placement(index, earlier);
    return placement.fits ? largestDisplacement(placement, size_, center_) : -1.0;
  };
  return core::largestGroup(light_, displacement, 0.5 * std::hypot(size_.width, size_.height));
}

std::string RefinedFusion::add(const cv::Mat& frame, const cv::Mat& gray, int index, double focus_mm,
                               const cv::Mat& opaque, bool may_wait) {
  const bool is_known = light_.frames().count(index) > 0;
  if (!is_known) observe(gray, index, focus_mm);
  const bool is_reference = reference_ < 0;
  if (is_reference) {
    reference_ = index;
    compareWithEarlier(gray);
    held_.clear();
    checkLens();
    if (predicts_) prediction_.setPicture(gray);
    lights_ = clippedLights(gray);
    if (relief_.isKnown()) gray.copyTo(reference_gray_);
    const bool resampled = config_.alignment && (alignment_.drifts() || alignment_.moves(reference_));
    mean_.begin(
        size_, noise_.deviation(),
        {config_.soft, config_.choice, frame.depth() == CV_16U, !(predicts_ && focus_known_) && !resampled});
    brightness_.begin(noise_.deviation(), resampled);
    exposure_.setReference(toEightBits(frame));
  }
  if (is_known && config_.alignment && !alignment_.placement(index, reference_).fits)
    alignment_.reconsider(gray, index, reference_);
  if (std::string reason = misfit(index, reference_); !reason.empty()) return reason;
  if (may_wait && !is_reference && config_.alignment && !hasMoved(index) &&
      light_.isSudden(index, fitting(reference_)))
    return "it shows something else than the frames before";
  const Placement placement = config_.alignment ? alignment_.placement(index, reference_) : Placement();
  CameraMotion motion{placement, {}};
  if (!is_reference && alignment_.drifts()) {
    motion = alignment_.measureDrift(reference_gray_, gray, placement);
    reference_gray_.release();
    noteDrift(motion);
  }
  AlignedFrame aligned{frame, cv::Rect({}, size_), 1, index, focus_mm, linear_, opaque};
  const bool is_still = motion.isIdentity();
  if (!is_still) aligned = warped(aligned, motion);
  if (!aligned.opaque.empty()) aligned.seen &= cv::boundingRect(aligned.opaque);
  if (config_.exposure && !is_reference) aligned.gain = exposure_.gain(toEightBits(aligned.image));
  if (on_aligned_) on_aligned_(aligned);
  addAligned(aligned, is_still ? gray : aligned_gray_, !is_still);
  return "";
}

// The frame in the geometry of the reference, and its gray picture in aligned_gray_.
AlignedFrame RefinedFusion::warped(AlignedFrame frame, const CameraMotion& motion) {
  if (motion.hasParallax()) {
    if (relief_image_.empty()) relief_image_ = reliefImage(relief_, size_);
    const ParallaxView view = viewOf(motion, relief_image_, center_);
    cv::remap(frame.image, aligned_, view.map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    cv::Mat shown = view.shown;
    if (!frame.opaque.empty()) {
      cv::remap(clear(frame.opaque), shown, view.map, cv::noArray(), cv::INTER_NEAREST, cv::BORDER_REPLICATE);
      shown &= view.shown;
    }
    frame.opaque = shown;
  } else {
    warp_.compute(frame.image, motion, center_, aligned_);
    frame.seen = seenThrough(motion, size_, center_);
    if (!frame.opaque.empty()) {
      cv::warpAffine(clear(frame.opaque), frame.opaque, motion.matrix(center_), size_,
                     cv::INTER_NEAREST | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
    }
  }
  frame.image = aligned_;
  cv::cvtColor(toEightBits(aligned_), aligned_gray_, cv::COLOR_BGR2GRAY);
  return frame;
}

void RefinedFusion::noteDrift(const CameraMotion& motion) {
  if (!motion.hasParallax() || focal_px_ <= 0) return;
  const CameraPose pose = poseOf(motion, relief_, focal_px_, size_);
  moved_mm_ = std::max(moved_mm_, cv::norm(pose.place_mm));
  turned_ = std::max(turned_, cv::norm(pose.rotation));
}

std::string RefinedFusion::driftNote() const {
  if (moved_mm_ == 0) return "";
  return cv::format("the camera moved by up to %.1f mm and turned by up to %.2f degrees: corrected by depth",
                    moved_mm_, turned_ * 180 / CV_PI);
}

std::string RefinedFusion::hiddenDriftNote() const {
  if (!config_.alignment || !relief_.filled.empty() || reference_ < 0) return "";
  const double px =
      alignment_.hiddenParallax(reference_, [this](int index) { return misfit(index, reference_).empty(); });
  if (px == 0) return "";
  return cv::format(
      "near and far things moved against each other by %.1f px or more between frames: the camera moved, not "
      "only its focus; give depth to correct it",
      px);
}

void RefinedFusion::addAligned(const AlignedFrame& frame, const cv::Mat& gray, bool resampled) {
  strips_.resize(stripCount(size_.height));
  const std::array<float, 256> lut = gainLut(frame.gain);
  SharpnessPyramid::Gauge gauge;
  gauge.noise = noise_;
  gauge.contrast = contrastGain(lut);
  gauge.resampled = resampled;
  gauge.scales = config_.scales;
  gauge.trust = !predicts_ || std::isnan(frame.focus_mm);
  if (focus_known_) gauge.predicted = predicted_;
  gauge.lights = lights_;
  sharpness_.begin(gray, gauge);
  const bool prefers_dark = config_.brightness && !linear_;
  if (prefers_dark) brightness_.beginFrame(gray, gauge.contrast);
  if (predicts_) {
    if (const cv::Mat texture = sharpness_.texture(); !texture.empty())
      prediction_.addTexture(texture, noise_.sharpness(prediction_.textureLevel()));
    const double focus_mm = std::isnan(frame.focus_mm) ? kUnknownFocus : lens_.focusOf(frame.index);
    prediction_.compute(focus_mm > focal_length_mm_ ? focus_mm : kUnknownFocus, squared_error_);
    cv::resize(squared_error_, upsampled_error_, size_, 0, 0, cv::INTER_LINEAR);
  }
  const bool is_deep = frame.image.depth() == CV_16U;
  is_deep ? mean_.beginFrame(frame.index, gainLut16(frame.gain)) : mean_.beginFrame(frame.index, lut);
  const cv::Rect& seen = frame.seen;
  fade_.begin(seen, size_);
  const RowStrips strips({seen.y, seen.br().y}, static_cast<int>(strips_.size()));
  strips.forEach([&](const cv::Range& rows, int i) {
    std::vector<float> parts;
    cv::Range block(rows.start, rows.start);
    for (int y = rows.start; y < rows.end; ++y) {
      if (y == block.end) {
        block = {y, std::min(y + SharpnessPyramid::kBlockRows, rows.end)};
        sharpness_.compute(block, strips_[i]);
      }
      float* sharpness = strips_[i].sharpness[y - block.start];
      if (prefers_dark) brightness_.weigh(y, sharpness);
      if (!frame.opaque.empty()) hide(frame.opaque.ptr(y), size_.width, sharpness);
      EvidenceRow evidence;
      evidence.sharpness = sharpness;
      if (predicts_) evidence.squared_error = upsampled_error_.ptr<float>(y);
      if (config_.soft) evidence.part = fade_.row(y, parts);
      const cv::Range columns(seen.x, seen.br().x);
      if (is_deep) {
        mean_.addRow(y, columns, frame.image.ptr<std::uint16_t>(y), evidence);
      } else {
        mean_.addRow(y, columns, frame.image.ptr<std::uint8_t>(y), evidence);
      }
    }
  });
}

}  // namespace all_in_focus::core
