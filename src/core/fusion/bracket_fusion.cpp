// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/bracket_fusion.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "alignment/reference_warp.hpp"
#include "all_in_focus/codes.hpp"
#include "fusion/brightness_penalty.hpp"
#include "fusion/camera_curve.hpp"
#include "fusion/clipped_lights.hpp"
#include "fusion/region_summary.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"
#include "util/transparency.hpp"

namespace all_in_focus::core {
namespace {

// At most so many frames are held until the reference comes: the first one, which may be the only one before
// it, and the latest ones. Some may show another scene.
constexpr size_t kMostHeld = 4;

// Light of a frame over that of the reference which exposure matching makes equal, with a margin because both
// measure.
constexpr double kMostLight = 1.1 * ExposureMatching::kLargestGain;

// Whether two frames may be compared for their noise. Neighbours differ least in blur and motion. But the
// codec of a video copies noise from frame to frame, so where frames are many, some must lie between.
bool areApart(int index, int earlier) {
  return index - earlier > index / 16;
}

// The pixels from which the kernel of a warp reaches no transparent one.
cv::Mat clear(const cv::Mat& opaque) {
  cv::Mat out;
  cv::erode(opaque, out, cv::Mat::ones(9, 9, CV_8UC1));
  return out;
}

// Factor on the sharpness of transparent pixels: they count less than the least share that counts.
constexpr float kNothing = 1e-6f;

ALL_IN_FOCUS_SIMD void blend(const float* a, const float* b, float part, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = (1 - part) * a[i] + part * b[i];
}

}  // namespace

void BracketFusion::begin(const BracketScene& scene, const cv::Size& size, Mode mode,
                          const RefinedConfig& config, bool drifts) {
  scene_ = scene;
  config_ = config;
  size_ = size;
  focus_mm_.clear();
  depth_ = -1;
  setLabels(scene.labels);
  by_region_ = mode == Mode::kPaper && !labels_.empty();
  if (by_region_) return regions_.begin(labels_);
  if (mode == Mode::kPaper) {
    // Without regions the sharpest frame a pixel, plainly copied.
    scene_.depth = cv::Mat();
    config_.alignment = config_.exposure = config_.soft = false;
  }
  beginRefined(drifts);
}

void BracketFusion::beginRefined(bool drifts) {
  reference_ = -1;
  center_ = {(size_.width - 1) / 2.0, (size_.height - 1) / 2.0};
  focal_length_mm_ = focal_px_ = 0;
  double pixel_pitch_mm = 0;
  if (scene_.camera) {
    // The camera may have been calibrated at another resolution.
    const double scale = static_cast<double>(size_.width) / scene_.camera->size.width;
    center_ = {(scene_.camera->cx + 0.5) * scale - 0.5, (scene_.camera->cy + 0.5) * scale - 0.5};
    focal_length_mm_ = scene_.optics.focal_length_mm;
    focal_px_ = scene_.camera->fx * scale;
    pixel_pitch_mm = scene_.calibratedPitch() / scale;
  }
  lens_ = {};
  focus_known_ = linear_ = false;
  noise_ = {};
  held_.clear();
  light_.clear();
  predicts_ = config_.prediction && !scene_.depth.empty() && pixel_pitch_mm > 0;
  if (predicts_) {
    prediction_.begin(scene_.depth, scene_.measured, size_, scene_.optics, pixel_pitch_mm);
    lens_.begin(scene_, pixel_pitch_mm, size_, center_);
  }
  moved_mm_ = turned_ = 0;
  relief_image_.release();
  relief_ = config_.alignment ? reliefOf(scene_.depth, scene_.measured) : Relief();
  alignment_.begin(size_, center_, relief_, drifts);
}

void BracketFusion::setLabels(const cv::Mat& labels) {
  labels_ = labels;
  if (!labels.empty() && labels.size() != size_) cv::resize(labels, labels_, size_, 0, 0, cv::INTER_NEAREST);
}

void BracketFusion::takeApart(const cv::Mat& frame) {
  if (depth_ < 0) depth_ = frame.depth();
  color_ = toBits(contentOf(frame, opaque_), depth_);
  cv::cvtColor(toEightBits(color_), gray_, cv::COLOR_BGR2GRAY);
}

void BracketFusion::observe(const cv::Mat& frame, int index, double focus_mm) {
  takeApart(frame);
  if (!by_region_) observeGray(index, focus_mm);
}

void BracketFusion::observeGray(int index, double focus_mm) {
  focus_known_ = focus_known_ || !std::isnan(focus_mm);
  light_.observe(gray_, index);
  if (config_.alignment) alignment_.observe(gray_, index);
  const bool is_behind = reference_ >= 0;
  if (predicts_ && !std::isnan(focus_mm)) lens_.observe(is_behind ? cv::Mat() : gray_, index, focus_mm);
  if (is_behind) return;
  if (!held_.empty() && !areApart(index, held_.front().index)) return;
  held_.push_front({index, gray_.clone()});
  if (held_.size() > kMostHeld) held_.erase(held_.end() - 2);
}

std::string BracketFusion::add(const cv::Mat& frame, int index, double focus_mm, bool may_wait) {
  takeApart(frame);
  if (by_region_) {
    regions_.add(color_, gray_, index);
  } else if (std::string misfit = addRefined(index, focus_mm, may_wait); !misfit.empty()) {
    return misfit;
  }
  focus_mm_.push_back(focus_mm);
  return "";
}

// The frame that was taken apart. Observes it unless it has been.
std::string BracketFusion::addRefined(int index, double focus_mm, bool may_wait) {
  const bool is_known = light_.frames().count(index) > 0;
  if (!is_known) observeGray(index, focus_mm);
  const bool is_reference = reference_ < 0;
  if (is_reference) setReference(index);
  if (is_known && config_.alignment && !alignment_.placement(index, reference_).fits)
    alignment_.reconsider(gray_, index, reference_);
  if (std::string reason = misfit(index, reference_); !reason.empty()) return reason;
  if (may_wait && !is_reference && config_.alignment && !hasMoved(index) &&
      light_.isSudden(index, fitting(reference_)))
    return "it shows something else than the frames before";
  const Placement placement = config_.alignment ? alignment_.placement(index, reference_) : Placement();
  CameraMotion motion{placement};
  if (!is_reference && (alignment_.drifts() || placement.shift != cv::Point2d())) {
    motion = alignment_.measureMotion(reference_gray_, gray_, placement);
    reference_gray_.release();
    noteDrift(motion);
  }
  AlignedFrame aligned{color_, cv::Rect({}, size_), 1, index, focus_mm, linear_, opaque_};
  const bool is_still = motion.isIdentity();
  cv::Mat gray;
  if (is_still) {
    gray = gray_;
  } else {
    aligned = warped(aligned, motion);
    cv::cvtColor(toEightBits(aligned.image), gray, cv::COLOR_BGR2GRAY);
  }
  if (!aligned.opaque.empty()) aligned.seen &= cv::boundingRect(aligned.opaque);
  if (config_.exposure && !is_reference) aligned.gain = exposure_.gain(gray);
  if (aligned.gain != 1) gray = withGain({gray, {}, aligned.gain});
  if (on_aligned_) on_aligned_(aligned);
  addAligned(aligned, gray, !is_still);
  return "";
}

void BracketFusion::setReference(int index) {
  reference_ = index;
  compareWithEarlier();
  checkLens();
  if (predicts_) prediction_.setPicture(gray_);
  lights_ = clippedLights(gray_);
  if (config_.alignment) gray_.copyTo(reference_gray_);
  resampled_ = config_.alignment && (alignment_.drifts() || alignment_.moves(reference_));
  mean_.begin(size_, noise_.deviation(),
              {config_.soft, config_.choice, !(predicts_ && focus_known_), resampled_});
  exposure_.setReference(gray_);
}

// Measures the noise of the reference and finds the camera's curve, by earlier frames. One that does not fit,
// or a copy of the reference, does not count.
void BracketFusion::compareWithEarlier() {
  std::vector<cv::Mat> others;  // the nearest first
  for (const HeldFrame& held : held_) {
    if (areApart(reference_, held.index) && cv::norm(held.gray, gray_, cv::NORM_INF) > 0 &&
        misfit(held.index, reference_).empty())
      others.push_back(held.gray);
  }
  held_.clear();
  linear_ = hasLinearCodes(gray_, others);
  if (!config_.noise) return;
  // Against the nearest one, which differs least in blur and motion, and the farthest.
  if (others.size() > 2) others = {others.front(), others.back()};
  noise_ = NoiseSpectrum::of(gray_, std::move(others));
}

// Corrects the prediction, or gives it up, where the frames up to the reference contradict f-number and focus
// distances. They do not tell while the camera moves: parallax looks like another blur.
void BracketFusion::checkLens() {
  if (!predicts_ || alignment_.drifts()) return;
  lens_.ask(linear_ ? LightCurve::linear() : LightCurve::srgb(), [this](int index) {
    return config_.alignment ? alignment_.placement(index, reference_) : Placement();
  });
  predicts_ = lens_.mayPredict();
  prediction_.setAperture(lens_.aperture());
}

// Whether the frame was taken from another place than the one before it: then all of it has changed.
bool BracketFusion::hasMoved(int index) const {
  const auto here = light_.frames().find(index);
  if (here == light_.frames().begin()) return false;
  const Placement placement = alignment_.placement(index, std::prev(here)->first);
  const double radius = 0.5 * std::hypot(size_.width, size_.height);
  return placement.measured && largestDisplacement(placement, size_, center_) > kSmallShift * radius;
}

// Says of a frame whether it fits.
std::function<bool(int)> BracketFusion::fitting(int reference) const {
  return [this, reference](int other) { return alignment_.placement(other, reference).fits; };
}

std::string BracketFusion::misfit(int index, int reference) const {
  if (by_region_) return "";
  const double light = config_.exposure ? light_.jump(index, reference, kMostLight) : 1;
  if (light != 1) {
    return cv::format("it is much %s than the others (%.2g times their light)",
                      light > 1 ? "brighter" : "darker", light);
  }
  if (!config_.alignment) return "";
  const std::string reason = "it shows something else than the others";
  if (!alignment_.placement(index, reference).fits)
    return reason + ": another scene, or the camera was moved";
  const double intrusion = hasMoved(index) ? 0 : light_.intrusion(index, fitting(reference));
  if (intrusion == 0) return "";
  return reason + cv::format(" in %.0f %% of the picture", 100 * intrusion) +
         ": something passed by, or the camera was moved";
}

FrameGroup BracketFusion::largestGroup() const {
  if (by_region_) return {};
  const auto displacement = [this](int index, int earlier) {
    if (!config_.alignment) return 0.0;
    const Placement placement = alignment_.placement(index, earlier);
    return placement.fits ? largestDisplacement(placement, size_, center_) : -1.0;
  };
  return core::largestGroup(light_, displacement, 0.5 * std::hypot(size_.width, size_.height));
}

// The frame in the geometry of the reference.
AlignedFrame BracketFusion::warped(AlignedFrame frame, const CameraMotion& motion) {
  if (motion.hasParallax()) {
    if (relief_image_.empty()) relief_image_ = reliefImage(relief_, size_);
    const ParallaxView view = viewOf(motion, relief_image_, center_);
    cv::Mat image;
    cv::remap(frame.image, image, view.map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    frame.image = image;
    cv::Mat shown = view.shown;
    if (!frame.opaque.empty()) {
      cv::remap(clear(frame.opaque), shown, view.map, cv::noArray(), cv::INTER_NEAREST, cv::BORDER_REPLICATE);
      shown &= view.shown;
    }
    frame.opaque = shown;
  } else if (!motion.isSimilarity()) {
    const cv::Matx33d homography = motion.homography(center_, size_);
    cv::Mat image,
        shown = frame.opaque.empty() ? cv::Mat(size_, CV_8UC1, cv::Scalar(255)) : clear(frame.opaque);
    cv::warpPerspective(frame.image, image, homography, size_, cv::INTER_CUBIC | cv::WARP_INVERSE_MAP,
                        cv::BORDER_REPLICATE);
    cv::warpPerspective(shown, frame.opaque, homography, size_, cv::INTER_NEAREST | cv::WARP_INVERSE_MAP);
    frame.image = image;
    frame.seen = seenThrough(motion, size_, center_);
  } else {
    frame.image = warpedToReference(frame.image, motion, center_);
    frame.seen = seenThrough(motion, size_, center_);
    if (!frame.opaque.empty()) {
      cv::warpAffine(clear(frame.opaque), frame.opaque, motion.matrix(center_), size_,
                     cv::INTER_NEAREST | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
    }
  }
  return frame;
}

void BracketFusion::noteDrift(const CameraMotion& motion) {
  if (!motion.hasParallax() || focal_px_ <= 0) return;
  const CameraPose pose = poseOf(motion, relief_, focal_px_, size_);
  moved_mm_ = std::max(moved_mm_, cv::norm(pose.place_mm));
  turned_ = std::max(turned_, cv::norm(pose.rotation));
}

std::string BracketFusion::hiddenDriftNote() const {
  if (by_region_ || !config_.alignment || !relief_.filled.empty() || reference_ < 0) return "";
  const double px =
      alignment_.hiddenParallax(reference_, [this](int index) { return misfit(index, reference_).empty(); });
  if (px == 0) return "";
  return cv::format(
      "near and far things moved against each other by %.1f px or more between frames: the camera moved, not "
      "only its focus; give depth to correct it",
      px);
}

void BracketFusion::addAligned(const AlignedFrame& frame, const cv::Mat& gray, bool resampled) {
  SharpnessPyramid::Gauge gauge;
  gauge.noise = noise_;
  gauge.resampled = resampled;
  gauge.scales = config_.scales;
  gauge.trust = !predicts_ || std::isnan(frame.focus_mm);
  if (predicts_ && focus_known_) gauge.predicted = prediction_.known();
  gauge.lights = lights_;
  if (config_.brightness && !linear_)
    gauge.brightness = brightnessOf(gray, noise_.deviation(), resampled_, codeWithGain(255, frame.gain));
  sharpness_.begin(gray, gauge);
  if (predicts_) {
    if (const cv::Mat texture = sharpness_.texture(); !texture.empty())
      prediction_.addTexture(texture, noise_.sharpness(prediction_.textureLevel()));
    const double focus_mm = std::isnan(frame.focus_mm) ? kUnknownFocus : lens_.focusOf(frame.index);
    prediction_.compute(focus_mm > focal_length_mm_ ? focus_mm : kUnknownFocus, squared_error_);
    cv::resize(squared_error_, wide_error_, {size_.width, squared_error_.rows}, 0, 0, cv::INTER_LINEAR);
  }
  const cv::Range columns(frame.seen.x, frame.seen.br().x), rows(frame.seen.y, frame.seen.br().y);
  const bool fades = config_.soft && frame.seen.size() != size_;
  const std::vector<float> fade_x = fadeAlong(columns, size_.width), fade_y = fadeAlong(rows, size_.height);
  mean_.beginFrame(frame.index, gainLut(frame.gain, depth_));
  forEachBlock(rows, [&](const cv::Range& block) {
    cv::Mat1f sharpness = sharpness_.compute(block);
    std::vector<float> parts(fade_x.size()), error(fade_x.size());
    for (int y = block.start; y < block.end; ++y) {
      float* row = sharpness[y - block.start];
      for (int x = 0; !frame.opaque.empty() && x < size_.width; ++x)
        row[x] *= frame.opaque.at<std::uint8_t>(y, x) != 0 ? 1 : kNothing;
      EvidenceRow evidence{row};
      if (predicts_) {
        const double place =
            std::clamp((y + 0.5) * wide_error_.rows / size_.height - 0.5, 0.0, wide_error_.rows - 1.0);
        const int above = static_cast<int>(place), below = std::min(above + 1, wide_error_.rows - 1);
        blend(wide_error_[above], wide_error_[below], static_cast<float>(place - above), size_.width,
              error.data());
        evidence.squared_error = error.data();
      }
      if (fades) evidence.part = fade_x.data();
      if (fades && fade_y[y] != 1) {
        std::transform(fade_x.begin(), fade_x.end(), parts.begin(),
                       [part = fade_y[y]](float along) { return part * along; });
        evidence.part = parts.data();
      }
      mean_.addRow(y, columns, frame.image, evidence);
    }
  });
}

FusionResult BracketFusion::result() const {
  if (focus_mm_.empty()) throw std::logic_error("fusion: no frame yet");
  FusionResult result;
  if (by_region_) {
    result.image = regions_.image().clone();
    result.source_index = regions_.sourceIndex();
    result.confidence = regions_.confidence();
    result.regions = regions_.choices();
  } else {
    result.image = mean_.image(depth_);
    if (config_.choice) {
      result.source_index = mean_.sourceIndex().clone();
      result.confidence = mean_.confidence();
      if (!labels_.empty())
        result.regions = summarizeRegions(labels_, result.source_index, result.confidence);
    }
    result.notes = unreachedDistances(scene_, focus_mm_);
    result.lens_notes = lens_.notes();
    if (moved_mm_ > 0) {
      result.notes.push_back(
          cv::format("the camera moved by up to %.1f mm and turned by up to %.2f degrees: corrected by depth",
                     moved_mm_, turned_ * 180 / CV_PI));
    }
  }
  return result;
}

}  // namespace all_in_focus::core
