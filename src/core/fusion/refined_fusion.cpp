// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/refined_fusion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "all_in_focus/codes.hpp"
#include "fusion/camera_curve.hpp"
#include "fusion/clipped_lights.hpp"
#include "optics/lens_fit.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

// At most so many frames are held until the reference comes: the first one and the latest ones. Some may show
// another scene.
constexpr size_t kMostHeld = 4;

// Light of a frame over that of the reference which exposure matching makes equal, with a margin because both
// measure.
constexpr double kMostLight = 1.1 * ExposureMatching::kLargestGain;

// Of the copies by which the lens is checked.
constexpr double kCopyPixels = 40e3;
constexpr size_t kMostCopies = 12;
// Share of the blur that right numbers explain at least. Noise and blur of less than a pixel of the copies
// lower it: then other distances may seem to explain more.
constexpr double kRight = 0.5;

// A whole number, with which it is quick.
double shrinkingOf(const cv::Size& size) {
  return std::round(BlurEvidence::shrinking(size, kCopyPixels));
}

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
  focus_mm_.clear();
  copies_.clear();
  copy_step_ = 1;
  observed_ = 0;
  lens_notes_.clear();
  predicted_.release();
  lights_.release();
  focus_known_ = false;
  noise_ = {};
  linear_ = false;
  held_.clear();
  light_.clear();
  predicts_ = config.prediction && !scene.depth.empty() && pixel_pitch_mm > 0;
  if (predicts_) {
    scene_ = scene;
    pixel_pitch_mm_ = pixel_pitch_mm;
    beginPrediction();
  }
  focal_px_ = scene.camera ? scene.camera->fx * size.width / scene.camera->size.width : 0;
  moved_mm_ = turned_ = 0;
  relief_image_.release();
  relief_ = config.alignment ? reliefOf(scene.depth, scene.measured) : Relief();
  alignment_.begin(size, center_, relief_);
}

void RefinedFusion::beginPrediction() {
  prediction_ = DefocusPrediction();
  prediction_.begin(scene_.depth, scene_.measured, size_, scene_.optics, pixel_pitch_mm_);
  // Windows of this level and of coarser ones reach farther than depth edges are uncertain.
  const size_t level = std::max<size_t>(prediction_.textureLevel(), 2) - 1;
  predicted_ = prediction_.known(SharpnessPyramid::levelSize(size_, level));
}

// Of every frame, or, in a long sweep, at equal steps.
void RefinedFusion::keepCopy(const cv::Mat& gray, int index, double focus_mm) {
  if (!predicts_ || std::isnan(focus_mm) || observed_++ % copy_step_ != 0) return;
  copies_.push_back({index, focus_mm, BlurEvidence::copyOf(gray, shrinkingOf(size_)), DetailMap::of(gray)});
  if (copies_.size() <= kMostCopies) return;
  copy_step_ *= 2;
  std::vector<Copy> left;
  for (size_t i = 0; i < copies_.size(); i += 2) left.push_back(std::move(copies_[i]));
  copies_ = std::move(left);
}

// Whether the frames up to the reference agree with f-number and focus distances. Else those are corrected
// for the prediction or, where that cannot be done for frames that are still to come, there is none.
void RefinedFusion::checkLens() {
  const std::vector<Copy> copies = std::move(copies_);
  copies_.clear();
  if (!predicts_ || copies.size() < 2) return;
  if (alignment_.drifts()) return;  // parallax, which copies are not freed of, looks like another blur
  const cv::Size size = copies[0].gray.size();
  const double shrink = 1 / shrinkingOf(size_);
  const LightCurve& curve = linear_ ? LightCurve::linear() : LightCurve::srgb();
  const double mean = cv::mean(copies.back().gray)[0];
  std::vector<BlurEvidence::Frame> frames;
  std::vector<FocusVotes::Frame> details;
  std::vector<FrameBlur> blur;
  cv::Mat1f sharpest(size, 0.0f), sharpness;
  cv::Mat fused(size, CV_8UC1);
  for (const Copy& copy : copies) {
    const Placement placement =
        config_.alignment ? alignment_.placement(copy.index, reference_) : Placement();
    if (!placement.fits) continue;
    cv::Rect seen({}, size);
    cv::Mat gray = copy.gray;
    if (!placement.isIdentity()) {
      const cv::Rect all = seenThrough(placement, size_, center_);
      seen &= cv::Rect(
          cv::Point(static_cast<int>(std::ceil(all.x * shrink)), static_cast<int>(std::ceil(all.y * shrink))),
          cv::Point(static_cast<int>(all.br().x * shrink), static_cast<int>(all.br().y * shrink)));
      cv::Matx23d matrix = placement.matrix(center_);
      for (int i = 0; i < 2; ++i)  // pixels of the copies, whose middles lie elsewhere
        matrix(i, 2) = shrink * matrix(i, 2) + (1 - shrink) / 2 * (matrix(i, 0) + matrix(i, 1) - 1);
      cv::warpAffine(copy.gray, gray, matrix, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                     cv::BORDER_REPLICATE);
    }
    const double gain = mean / std::max(1.0, cv::mean(gray)[0]);
    details.push_back({copy.detail, placement.matrix(center_), gain});
    gray.convertTo(gray, CV_32F, gain);
    cv::Laplacian(gray, sharpness, CV_32F);
    cv::blur(cv::abs(sharpness), sharpness, {5, 5});
    const cv::Mat sharper = sharpness >= sharpest;
    cv::Mat codes;
    gray.convertTo(codes, CV_8U);
    codes.copyTo(fused, sharper);
    sharpness.copyTo(sharpest, sharper);
    frames.push_back({gray, seen});
    blur.push_back(frameBlur(scene_.optics, pixel_pitch_mm_ / shrink, 1 / copy.focus_mm));
  }
  if (frames.size() < 2) return;
  cv::Mat1f inverse_depth(size, 0.0f);
  const cv::Mat& depth = scene_.measured.empty() ? scene_.depth : scene_.measured;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const int mm = depth.at<std::uint16_t>(y * depth.rows / size.height, x * depth.cols / size.width);
      if (mm > 0) inverse_depth(y, x) = 1.0f / static_cast<float>(mm);
    }
  }
  const std::optional<FocusCorrection> voted = FocusVotes(details, depth, size_).correctionOf(blur);
  if (voted && voted->reversed) {
    lens_notes_.emplace_back(
        "the frames show that the focus distances are in reverse order: depth and lens data are not used");
    predicts_ = false;
    predicted_.release();
    return;
  }
  const BlurEvidence evidence(fused, frames, curve, inverse_depth);
  if ((!voted || voted->isNone()) && evidence.explained(blur, 1) >= kRight) return;
  const LensFit fit = voted ? fitLens(evidence, blur, *voted) : fitLens(evidence, blur, true);
  lens_notes_ = fit.notes(scene_.optics);
  const bool is_right = fit.scale == 1 && fit.focus.isNone();
  const double least = voted && fit.scale == 1 ? kRight
                       : voted || is_right     ? LensFit::kBelieved
                                               : LensFit::kTrusted;
  const bool drops = fit.explained < least || !fit.uses_depth || !fit.is_certain ||
                     (fit.focus.shift != 0 && copy_step_ > 1);  // by how many frames is not known then
  if (drops)
    lens_notes_.assign(1,
                       "the frames contradict focus distances or f-number: depth and lens data are not used");
  if (drops || fit.focus.reversed || (fit.focus.shift != 0 && !voted)) {
    predicts_ = false;
    predicted_.release();
  } else if (!is_right) {
    lens_ = fit;
    scene_.optics.aperture /= fit.scale;
    beginPrediction();
  }
}

// Of a frame that has been observed. What comes next is not known yet: there the list goes on in even steps.
double RefinedFusion::correctedFocus(int index) const {
  const auto here = focus_mm_.find(index);
  if (lens_.focus.isNone()) return here->second;
  double inverse = 1 / here->second;
  if (lens_.focus.shift != 0) {
    const bool late = lens_.focus.shift > 0;
    const auto before = here == focus_mm_.begin() ? focus_mm_.end() : std::prev(here),
               behind = std::next(here);
    const auto from = late ? behind : before;
    const auto other = late ? before : behind;
    if (from != focus_mm_.end()) {
      inverse = 1 / from->second;
    } else if (other != focus_mm_.end()) {
      inverse += inverse - 1 / other->second;
    }
  }
  return inverse > 0 ? lens_.focus.factor / inverse : std::numeric_limits<double>::infinity();
}

void RefinedFusion::observe(const cv::Mat& gray, int index, double focus_mm) {
  if (focus_mm <= focal_length_mm_) {
    throw std::invalid_argument(
        cv::format("fusion: frame %d is focused at %g mm, not beyond the focal length, %g mm", index,
                   focus_mm, focal_length_mm_));
  }
  focus_known_ = focus_known_ || !std::isnan(focus_mm);
  if (!std::isnan(focus_mm)) focus_mm_[index] = focus_mm;
  light_.observe(gray, index);
  if (config_.alignment) alignment_.observe(gray, index, light_.isOdd(index, kMostLight));
  if (reference_ >= 0) return;
  keepCopy(gray, index, focus_mm);
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
    const auto fits = [&](int other) { return alignment_.placement(other, reference).fits; };
    const double intrusion = hasMoved(index) ? 0 : light_.intrusion(index, fits);
    if (intrusion == 0) return "";
    return reason + cv::format(" in %.0f %% of the picture", 100 * intrusion) +
           ": something passed by, or the camera was moved";
  }
  if (!std::isnan(placement.correlation)) {
    reason +=
        cv::format(" (correlation %.2f, below %.2f)", placement.correlation, BracketAlignment::kSameScene);
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
                               const cv::Mat& opaque) {
  const bool is_known = light_.frames().count(index) > 0;
  if (!is_known) observe(gray, index, focus_mm);
  const bool is_reference = reference_ < 0;
  if (is_reference) {
    reference_ = index;
    compareWithEarlier(gray);
    held_.clear();
    checkLens();
    lights_ = clippedLights(gray);
    if (relief_.isKnown()) gray.copyTo(reference_gray_);
    const bool resampled = config_.alignment && (alignment_.drifts() || alignment_.moves(reference_));
    mean_.begin(size_, noise_.deviation(),
                {config_.soft, config_.choice, frame.depth() == CV_16U, !predicts_ && !resampled});
    brightness_.begin(noise_.deviation(), resampled);
    exposure_.setReference(toEightBits(frame));
  }
  if (is_known && config_.alignment && !alignment_.placement(index, reference_).fits)
    alignment_.reconsider(gray, index, reference_);
  if (std::string reason = misfit(index, reference_); !reason.empty()) return reason;
  CameraMotion motion;
  if (config_.alignment) static_cast<SimilarityTransform&>(motion) = alignment_.placement(index, reference_);
  if (!is_reference && alignment_.drifts()) {
    motion = alignment_.measureDrift(reference_gray_, gray, motion);
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
    const double focus_mm = std::isnan(frame.focus_mm) ? kUnknownFocus : correctedFocus(frame.index);
    prediction_.compute(focus_mm > scene_.optics.focal_length_mm ? focus_mm : kUnknownFocus, squared_error_);
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
