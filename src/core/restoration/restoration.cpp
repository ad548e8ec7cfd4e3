// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/restoration.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/depth_registration.hpp"
#include "fusion/noise_estimation.hpp"
#include "restoration/blur_scale.hpp"
#include "restoration/bracket_depth.hpp"
#include "restoration/contours.hpp"
#include "restoration/image_formation.hpp"
#include "restoration/inversion.hpp"
#include "restoration/observed_bracket.hpp"
#include "util/row_strips.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

// Deviations of the blur scale from 1: smaller ones may be errors of the measurement; larger ones call for a
// note.
constexpr double kNoticeable = 0.03, kUnusual = 0.1;
constexpr double kLeastCorrection = 0.7, kLargestCorrection = 1.3;
constexpr double kRangeMarginPx = 0.5;  // of blur, beyond the depth that was measured
constexpr double kRangeShare = 0.005;   // of measured pixels that may lie beyond, at each end
constexpr int kLeastFrames = 2;
// Pictures are downsampled until the largest blur disc has this radius, for time grows with its area, and to
// so many pixels, but no further than to so few.
constexpr double kLargestBlurPx = 8, kMostPixels = 1200e3, kLeastPixels = 400e3;
constexpr int kMostSampled = 640;  // columns and rows of depth, to find the largest disc

// Of contours, in each round.
constexpr std::array<float, 2> kStiffness = {2, 1};

cv::Mat downsampled(const cv::Mat& image, const cv::Size& size) {
  if (image.size() == size) return image.clone();
  cv::Mat small;
  cv::resize(image, small, size, 0, 0, cv::INTER_AREA);
  return small;
}

cv::Rect downsampled(const cv::Rect& seen, const cv::Size& from, const cv::Size& to) {
  if (from == to) return seen;
  const double x = static_cast<double>(to.width) / from.width,
               y = static_cast<double>(to.height) / from.height;
  const cv::Point first(static_cast<int>(std::ceil(seen.x * x)), static_cast<int>(std::ceil(seen.y * y)));
  const cv::Point last(static_cast<int>(seen.br().x * x), static_cast<int>(seen.br().y * y));
  return cv::Rect(first, last) & cv::Rect({}, to);
}

// Depth in mm, any size -> inverse depth, 1/mm, 0 = unknown.
cv::Mat1f inverseDepthOf(const cv::Mat& depth, const cv::Size& size) {
  cv::Mat scaled;
  resizeDepth(depth, size, scaled);
  cv::Mat1f inverse_depth(size);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const int mm = scaled.at<std::uint16_t>(y, x);
      inverse_depth(y, x) = mm > 0 ? 1.0f / static_cast<float>(mm) : 0;
    }
  }
  return inverse_depth;
}

cv::Mat depthOf(const cv::Mat1f& inverse_depth, const cv::Size& size) {
  cv::Mat1w depth(inverse_depth.size());
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      const float mm = 1 / std::max(inverse_depth(y, x), 1e-9f);
      depth(y, x) = static_cast<std::uint16_t>(std::clamp(mm + 0.5f, 1.0f, 65535.0f));
    }
  }
  cv::Mat scaled;
  resizeDepth(depth, size, scaled);
  return scaled;
}

// Of all that is known but a few outliers; nothing where nothing is known.
std::optional<InverseDepthRange> rangeOf(const cv::Mat1f& inverse_depth) {
  std::vector<float> there;
  for (const float value : inverse_depth) {
    if (value > 0) there.push_back(value);
  }
  if (there.empty()) return std::nullopt;
  InverseDepthRange range;
  const size_t beyond = static_cast<size_t>(kRangeShare * static_cast<double>(there.size()));
  std::nth_element(there.begin(), there.begin() + beyond, there.end());
  range.least = there[beyond];
  std::nth_element(there.begin(), there.end() - 1 - beyond, there.end());
  range.largest = there[there.size() - 1 - beyond];
  return range;
}

// What the depth sensor saw, or, without one, what the lens was focused on.
InverseDepthRange rangeOf(const ObservedBracket& bracket) {
  const InverseDepthRange focused = {static_cast<float>(bracket.frames.front().blur.inverse_depth),
                                     static_cast<float>(bracket.frames.back().blur.inverse_depth)};
  const InverseDepthRange range = rangeOf(bracket.filled).value_or(focused);
  const float margin = bracket.gap(kRangeMarginPx);
  return {std::max(0.0f, range.least - margin), range.largest + margin};
}

// Blur of a frame in pictures of that many columns.
FrameBlur blurOf(const BracketScene& scene, double inverse_depth, int columns) {
  const double f = scene.optics.focal_length_mm;
  const double pitch = scene.calibratedPitch() * scene.camera->size.width / columns;
  return {inverse_depth, f * f / (2 * scene.optics.aperture * pitch) / (1 - f * inverse_depth)};
}

// The size in which a bracket is restored.
cv::Size workingSize(const BracketScene& scene, const cv::Size& size) {
  double pixels = kLeastPixels;
  if (scene.camera && !scene.depth.empty()) {
    const cv::Size sampled(std::min(scene.depth.cols, kMostSampled),
                           std::min(scene.depth.rows, kMostSampled));
    if (const auto range = rangeOf(inverseDepthOf(scene.depth, sampled))) {
      const double blur = blurOf(scene, range->largest, size.width).radius(range->least) / kLargestBlurPx;
      // In this order, for blur is NaN where the depth is the focal length.
      pixels = std::clamp(size.area() / std::max(1e-6, blur * blur), kLeastPixels, kMostPixels);
    }
  }
  const double scale = std::min(1.0, std::sqrt(pixels / size.area()));
  return {std::max(1, static_cast<int>(std::lround(size.width * scale))),
          std::max(1, static_cast<int>(std::lround(size.height * scale)))};
}

// What lies beyond a range is as near as its end.
void cut(const InverseDepthRange& range, cv::Mat1f& inverse_depth) {
  for (float& value : inverse_depth) {
    if (value > 0) value = std::clamp(value, range.least, range.largest);
  }
}

double largestRadius(const ObservedBracket& bracket, const InverseDepthRange& range) {
  float largest = 0;
  for (const ObservedFrame& frame : bracket.frames)
    largest = std::max({largest, frame.blur.radius(range.least), frame.blur.radius(range.largest)});
  return largest;
}

// Of a channel, in the frame that shows least texture beside it.
double noiseVariance(const std::vector<cv::Mat>& frames) {
  double deviation = std::numeric_limits<double>::infinity();
  cv::Mat green;
  for (const cv::Mat& frame : frames) {
    cv::extractChannel(frame, green, 1);
    deviation = std::min(deviation, NoiseSpectrum::of(green).whiteDeviation());
  }
  return deviation * deviation;
}

// A channel of the fused picture that is this dark is not brightened, one this bright as the equations say;
// gray levels.
constexpr float kNeverBrightened = 20, kFreelyBrightened = 100;

// Blur raises dark values by much and lowers bright ones by little, and the fused picture prefers dark
// frames. So what it shows as dark is rarely too dark. Neither holds where codes are in proportion to light.
void keepDark(const cv::Mat3b& fused, cv::Mat3f& correction) {
  forEachRow(fused.rows, [&](int y) {
    for (int x = 0; x < fused.cols; ++x) {
      for (int c = 0; c < 3; ++c) {
        float& z = correction(y, x)[c];
        const float brightness = static_cast<float>(fused(y, x)[c]);
        const float share = (brightness - kNeverBrightened) / (kFreelyBrightened - kNeverBrightened);
        if (z > 0) z *= std::clamp(share, 0.0f, 1.0f);
      }
    }
  });
}

void addTo(cv::Mat& image, const cv::Mat3f& correction) {
  cv::Mat3f upsampled = correction;
  if (correction.size() != image.size())
    cv::resize(correction, upsampled, image.size(), 0, 0, cv::INTER_LINEAR);
  const double unit = image.depth() == CV_16U ? kDeepPerCode : 1;
  cv::add(image, unit == 1 ? upsampled : cv::Mat3f(unit * upsampled), image, cv::noArray(), image.depth());
}

}  // namespace

void BracketRestoration::begin(const BracketScene& scene) {
  validate(scene.optics);
  if (scene.camera) validate(*scene.camera, "colour camera");
  scene_ = scene;
  size_ = working_size_ = {};
  focus_unknown_ = linear_ = false;
  held_.clear();
}

void BracketRestoration::add(const AlignedFrame& frame) {
  size_ = frame.image.size();
  if (std::isnan(frame.focus_mm)) {
    focus_unknown_ = true;
    return;
  }
  if (held_.empty()) working_size_ = workingSize(scene_, size_);
  HeldFrame held;
  held.image = downsampled(toEightBits(frame.image), working_size_);
  held.seen = downsampled(frame.seen, size_, working_size_);
  held.gain = frame.gain;
  held.inverse_depth = 1 / frame.focus_mm;
  linear_ = frame.linear;
  const auto place = std::upper_bound(
      held_.begin(), held_.end(), held,
      [](const HeldFrame& a, const HeldFrame& b) { return a.inverse_depth < b.inverse_depth; });
  held_.insert(place, held);
  if (held_.size() > kMostFrames) dropOne();
}

// Drops the frame that is nearest to its neighbours.
void BracketRestoration::dropOne() {
  size_t dropped = 1;
  for (size_t i = 2; i + 1 < held_.size(); ++i) {
    const auto gap = [&](size_t k) { return held_[k + 1].inverse_depth - held_[k - 1].inverse_depth; };
    if (gap(i) < gap(dropped)) dropped = i;
  }
  held_.erase(held_.begin() + static_cast<std::ptrdiff_t>(dropped));
}

std::string BracketRestoration::missing() const {
  if (!scene_.camera) return "the pixel pitch is unknown: the colour camera's calibration is missing";
  if (held_.size() < kLeastFrames)
    return focus_unknown_ ? "the focus distances are unknown"
                          : "two frames at different distances are needed";
  if (held_.front().inverse_depth == held_.back().inverse_depth)
    return "all frames are focused at the same distance";
  return "";
}

std::optional<RestorationResult> BracketRestoration::restore(const cv::Mat& fused,
                                                             const Progress& progress) const {
  if (!missing().empty()) throw std::logic_error("restoration: " + missing());
  if ((fused.type() != CV_8UC3 && fused.type() != CV_16UC3) || fused.size() != size_)
    throw std::invalid_argument(
        "restoration: the fused picture must have three channels and the frames' size");
  const auto proceed = [&](double done) { return !progress || progress(done); };
  const auto part = [&](double from, double to) {
    return [&proceed, from, to](double done) { return proceed(from + done * (to - from)); };
  };
  if (!proceed(0)) return std::nullopt;

  // 1. All pictures in one size and one exposure.
  ObservedBracket bracket;
  bracket.fused = downsampled(toEightBits(fused), working_size_);
  bracket.curve = linear_ ? &LightCurve::linear() : &LightCurve::srgb();
  bracket.light = linearLight(bracket.fused, *bracket.curve);
  std::vector<cv::Mat> images;
  bracket.frames.resize(held_.size());
  for (size_t k = 0; k < held_.size(); ++k) {
    const HeldFrame& held = held_[k];
    ObservedFrame& frame = bracket.frames[k];
    frame.codes = exposed(held.image, held.gain, *bracket.curve);
    frame.seen = held.seen;
    frame.blur = blurOf(scene_, held.inverse_depth, working_size_.width);
    bracket.px_mm = std::max(bracket.px_mm, frame.blur.px_mm);
    images.push_back(held.image);
  }
  bracket.noise_variance = noiseVariance(images);
  const bool has_depth = !scene_.depth.empty();
  if (has_depth) {
    bracket.filled = inverseDepthOf(scene_.depth, working_size_);
    bracket.measured =
        scene_.measured.empty() ? bracket.filled.clone() : inverseDepthOf(scene_.measured, working_size_);
  }
  InverseDepthRange range = rangeOf(bracket);
  if (has_depth) {
    cut(range, bracket.filled);
    cut(range, bracket.measured);
  }
  if (!proceed(0.05)) return std::nullopt;

  // 2. The fused picture at every amount of blur; whether the optics predict the right one.
  RestorationResult result;
  auto pictures = std::make_unique<BlurredPictures>(bracket.light, *bracket.curve,
                                                    kLargestCorrection * largestRadius(bracket, range));
  if (!proceed(0.2)) return std::nullopt;
  if (has_depth) result.blur_scale = measureBlurScale(bracket, *pictures);
  const double deviation = result.blur_scale > 0 ? std::abs(result.blur_scale - 1) : 0;
  if (deviation > kNoticeable) {
    const double correction = std::clamp(result.blur_scale, kLeastCorrection, kLargestCorrection);
    for (ObservedFrame& frame : bracket.frames) frame.blur.px_mm *= correction;
    bracket.px_mm *= correction;
  }
  if (deviation > kUnusual) {
    result.notes.push_back(cv::format(
        "the frames are blurred %.2f times as much as the optics say: check focal length, aperture, "
        "focus distances and calibration",
        result.blur_scale));
  }

  // 3. The depth map that explains the frames.
  cv::Mat1f inverse_depth = depthFromBracket(bracket, *pictures, range);
  pictures.reset();  // by far the largest part of memory
  if (!has_depth) {
    cv::medianBlur(inverse_depth, bracket.filled, 5);  // without outliers, which nobody contradicts
    bracket.filled.copyTo(inverse_depth);
  }
  if (!proceed(0.4)) return std::nullopt;

  // 4. Its contours to the pixel, and the sharp picture that explains the frames better than the fused one;
  // twice, because the blur that the fused picture shows beside near objects misleads contours.
  std::vector<ImageFormation> formation;
  formation.reserve(bracket.frames.size());
  for (const ObservedFrame& frame : bracket.frames)
    formation.emplace_back(inverse_depth, frame.blur, bracket.gap(kJumpPx));
  updateAll(formation);
  const cv::Mat3b given = bracket.fused;
  cv::Mat3f sum(given.size(), cv::Vec3f::all(0));
  double from = 0.4;
  for (const float stiffness : kStiffness) {
    if (!moveContours(bracket, formation, inverse_depth, stiffness, part(from, from + 0.15)))
      return std::nullopt;
    const std::optional<cv::Mat3f> z =
        correction(bracket, formation, inverse_depth, part(from + 0.15, from + 0.3));
    if (!z) return std::nullopt;
    sum += *z;
    bracket.fused = given.clone();
    addTo(bracket.fused, sum);
    bracket.light = linearLight(bracket.fused, *bracket.curve);
    from += 0.3;
  }
  if (!linear_) keepDark(given, sum);
  result.image = fused.clone();
  addTo(result.image, sum);
  result.depth = depthOf(inverse_depth, size_);
  proceed(1);
  return result;
}

}  // namespace all_in_focus::core
