// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/restoration.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/depth_registration.hpp"
#include "fusion/clipped_lights.hpp"
#include "fusion/noise_estimation.hpp"
#include "optics/focus_votes.hpp"
#include "optics/lens_fit.hpp"
#include "restoration/bracket_depth.hpp"
#include "restoration/contours.hpp"
#include "restoration/image_formation.hpp"
#include "restoration/inversion.hpp"
#include "restoration/observed_bracket.hpp"
#include "util/row_strips.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct RestorationParameters {
  // Pictures are downsampled until the largest blur disc has this radius, px, for time grows with its area,
  // and to so many pixels, but no further than to so few.
  double largest_blur = 8, most_pixels = 1200e3, least_pixels = 400e3;
  int most_sampled = 640;  // columns and rows of depth, to find the largest disc
  // The lens.
  double copy_pixels = 100e3;  // of the copies that tell the blur
  double guessed_blur = 3;     // px of the copies, over the whole sweep, without focus distances
  // Depth.
  double range_margin = 0.5;   // px of blur, beyond the depth that was measured
  double range_share = 0.005;  // of measured pixels that may lie beyond, at each end
  double occlusion = 1.5;      // px of blur; at smaller jumps little is covered
  int beside = 4;              // px; how far from jumps coverage is looked at
  int order_tile = 16;         // px; errors of different tiles count as independent
  double order = 2.5;          // standard deviations that tell near from far
  double turned = 0.93;  // share of the error that must be left, too, to turn focus distances that were given
  float most_squared_error = 3 * 900;  // of a pixel; larger ones are cut, as it may show what no other does
  // Of contours, in each round: in the first one they lie at colour edges.
  std::array<float, 2> stiffness = {2, 1};
  // Does the depth explain the frame that the given picture shows? Error that it leaves, as a share of the
  // contrast there, up to which all of a correction is kept, and at which nothing.
  float unexplained = 0.05f, wrong = 0.2f;
  double shown_sigma = 1;       // px: differences that tell which frame is shown are means over that
  double error_sigma = 2;       // px: so are error and contrast
  double detail_sigma = 3;      // px; contrast is of finer detail
  double least_contrast = 100;  // gray levels squared
  double told_share = 0.9;      // of a correction; if less is kept, a note says so
  // A channel of the fused picture that is this dark is not brightened, one this bright as the equations say;
  // gray levels. (Without: slope_24mm -0.4 dB, motorcycle_breathing +0.2, 30 scenes -0.06.)
  float never_brightened = 20, freely_brightened = 100;
} kRestoration{};

constexpr std::uint8_t kNoneShown = 255;  // instead of a frame's place in the bracket

cv::Mat downsampled(const cv::Mat& image, const cv::Size& size) {
  if (image.size() == size) return image.clone();
  cv::Mat small;
  cv::resize(image, small, size, 0, 0, cv::INTER_AREA);
  return small;
}

cv::Mat depthOf(const cv::Mat1f& inverse_depth, const cv::Size& size) {
  cv::Mat depth, scaled;
  cv::Mat(1 / cv::max(inverse_depth, 1e-9f)).convertTo(depth, CV_16U);
  resizeDepth(cv::max(depth, 1), size, scaled);
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
  const size_t beyond = static_cast<size_t>(kRestoration.range_share * static_cast<double>(there.size()));
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
  const float margin = bracket.gap(kRestoration.range_margin);
  return {std::max(0.0f, range.least - margin), range.largest + margin};
}

// What the frames say about their blur, in copies that are so many times smaller.
BlurEvidence evidenceOf(const ObservedBracket& bracket, double shrinking) {
  const auto gray = [&](const cv::Mat& image, double unit) {
    cv::Mat small, out;
    cv::cvtColor(BlurEvidence::copyOf(image, shrinking), small, cv::COLOR_BGR2GRAY);
    small.convertTo(out, unit == 1 ? CV_8U : CV_32F, 1 / unit);
    return out;
  };
  std::vector<BlurEvidence::Frame> frames;
  for (const ObservedFrame& frame : bracket.frames) {
    cv::Mat floats;
    frame.codes.convertTo(floats, CV_32F);
    frames.push_back({gray(floats, kCodeScale), {}});
    frames.back().seen = cv::boundingRect(BlurEvidence::copyOf(frame.shown, shrinking) == 255);
  }
  cv::Mat1f surfaces;
  if (!bracket.measured.empty()) {
    cv::resize(bracket.measured, surfaces, frames[0].gray.size(), 0, 0, cv::INTER_NEAREST);
  }
  return BlurEvidence(gray(bracket.fused, 1), frames, *bracket.curve, surfaces, shrinking);
}

// Blur of a frame in pictures of that many columns.
FrameBlur blurOf(const BracketScene& scene, double inverse_depth, int columns) {
  return frameBlur(scene.optics, scene.calibratedPitch() * scene.camera->size.width / columns, inverse_depth);
}

// Of the frames, in their order; scale: on radii.
std::vector<FrameBlur> blurOf(const ObservedBracket& bracket, double scale) {
  std::vector<FrameBlur> blur;
  for (const ObservedFrame& frame : bracket.frames)
    blur.push_back({frame.blur.inverse_depth, frame.blur.px_mm * scale, frame.blur.focal_length_mm});
  return blur;
}

// Gives the frames the lens that they show.
void correct(const LensFit& fit, ObservedBracket& bracket) {
  if (!fit.uses_depth) bracket.filled = bracket.measured = cv::Mat1f();
  const std::vector<FrameBlur> blur = fit.focus.of(blurOf(bracket, fit.scale));
  for (std::size_t k = 0; k < blur.size(); ++k) bracket.frames[k].blur = blur[k];
  std::stable_sort(bracket.frames.begin(), bracket.frames.end(),
                   [](const ObservedFrame& a, const ObservedFrame& b) {
                     return a.blur.inverse_depth < b.blur.inverse_depth;
                   });
}

// The size in which a bracket is restored.
cv::Size workingSize(const BracketScene& scene, const cv::Size& size) {
  double pixels = kRestoration.least_pixels;
  if (scene.camera && !scene.depth.empty()) {
    const cv::Size sampled(std::min(scene.depth.cols, kRestoration.most_sampled),
                           std::min(scene.depth.rows, kRestoration.most_sampled));
    if (const auto range = rangeOf(inverseDepthOf(scene.depth, sampled))) {
      const double blur =
          blurOf(scene, range->largest, size.width).radius(range->least) / kRestoration.largest_blur;
      // In this order, for blur is NaN where the depth is the focal length.
      pixels = std::clamp(size.area() / std::max(1e-6, blur * blur), kRestoration.least_pixels,
                          kRestoration.most_pixels);
    }
  }
  const double scale = std::min(1.0, std::sqrt(pixels / size.area()));
  return {std::max(1, static_cast<int>(std::lround(size.width * scale))),
          std::max(1, static_cast<int>(std::lround(size.height * scale)))};
}

// What lies beyond a range is as near as its end.
void cut(const InverseDepthRange& range, cv::Mat1f& inverse_depth) {
  const cv::Mat1b known(inverse_depth > 0);
  cv::Mat1f(cv::min(cv::max(inverse_depth, range.least), range.largest)).copyTo(inverse_depth, known);
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

// Blur raises dark values by much and lowers bright ones by little, and the fused picture prefers dark
// frames. So what it shows as dark is rarely too dark. Neither holds where codes are in proportion to light.
// Where the camera moved, dark pixels of other frames may lie where nothing is dark.
void keepDark(const cv::Mat3b& fused, cv::Mat3f& correction) {
  inParallel(fused.rows, [&](int y) {
    for (int x = 0; x < fused.cols; ++x) {
      for (int c = 0; c < 3; ++c) {
        float& z = correction(y, x)[c];
        const float brightness = static_cast<float>(fused(y, x)[c]);
        const float share = (brightness - kRestoration.never_brightened) /
                            (kRestoration.freely_brightened - kRestoration.never_brightened);
        if (z > 0) z *= std::clamp(share, 0.0f, 1.0f);
      }
    }
  });
}

// The equations would enlarge a light that is brighter than white: its discs show more light than the fused
// picture has.
void keepLights(const cv::Mat3b& fused, const std::vector<cv::Mat>& frames, cv::Mat3f& correction) {
  std::vector<cv::Mat> grays(frames.size());
  for (size_t k = 0; k < frames.size(); ++k) cv::cvtColor(frames[k], grays[k], cv::COLOR_BGR2GRAY);
  cv::Mat gray, lights;
  cv::cvtColor(fused, gray, cv::COLOR_BGR2GRAY);
  lights = lightsBeyondWhite(gray, grays);
  if (lights.empty()) return;
  cv::resize(lights, lights, fused.size(), 0, 0, cv::INTER_NEAREST);
  correction.setTo(cv::Scalar(), lights);
}

std::vector<ImageFormation> formationOf(const ObservedBracket& bracket, const cv::Mat1f& inverse_depth) {
  std::vector<ImageFormation> formation;
  formation.reserve(bracket.frames.size());
  for (const ObservedFrame& frame : bracket.frames)
    formation.emplace_back(inverse_depth, frame.blur, bracket.gap(kJumpPx));
  updateAll(formation);
  return formation;
}

// Squared error of a pixel of a frame, as the lens makes it of a sharp picture; gray levels.
float squaredError(const ObservedFrame& frame, const ImageFormation& formation, const LightCurve& curve,
                   const cv::Mat4f& sharp, const cv::Point& p) {
  const cv::Vec3f predicted = formation.predict(p, formation.inverseDepth(p), sharp).light;
  float squared = 0;
  for (int c = 0; c < 3; ++c) {
    const float difference = curve.code(predicted[c]) - static_cast<float>(frame.codes(p)[c]) / kCodeScale;
    squared += difference * difference;
  }
  return squared;
}

// The sum over all frames, of every second row and column where it is asked for; else 0.
cv::Mat1f errorsOfAll(const ObservedBracket& bracket, const std::vector<ImageFormation>& formation,
                      const cv::Mat3f& light, const cv::Mat1b& asked) {
  const cv::Mat4f sharp = ImageFormation::withMargin(light);
  cv::Mat1f errors(asked.size(), 0.0f);
  inParallel((asked.rows + 1) / 2, [&](int row) {
    const int y = 2 * row;
    for (int x = 0; x < asked.cols; x += 2) {
      if (!asked(y, x)) continue;
      for (std::size_t k = 0; k < formation.size(); ++k) {
        if (!bracket.frames[k].shown(y, x)) continue;
        const float squared = squaredError(bracket.frames[k], formation[k], *bracket.curve, sharp, {x, y});
        errors(y, x) += std::min(squared, kRestoration.most_squared_error);
      }
    }
  });
  return errors;
}

// Of one frame for each pixel; 0 where that is kNoneShown.
cv::Mat1f errorsOf(const cv::Mat1b& frames, const ObservedBracket& bracket,
                   const std::vector<ImageFormation>& formation, const cv::Mat3f& light) {
  const cv::Mat4f sharp = ImageFormation::withMargin(light);
  cv::Mat1f errors(frames.size(), 0.0f);
  inParallel(frames.rows, [&](int y) {
    for (int x = 0; x < frames.cols; ++x) {
      const std::uint8_t k = frames(y, x);
      if (k != kNoneShown)
        errors(y, x) = squaredError(bracket.frames[k], formation[k], *bracket.curve, sharp, {x, y});
    }
  });
  return errors;
}

// The mean of the squared lengths of vectors about each pixel. sigma: px, of the Gaussian that weighs them.
cv::Mat1f meanSquares(const cv::Mat3f& vectors, double sigma) {
  cv::Mat1f squares;
  cv::transform(vectors.mul(vectors), squares, cv::Matx13f(1, 1, 1));
  cv::GaussianBlur(squares, squares, {}, sigma);
  return squares;
}

// The frame that a picture shows at each pixel: the one that differs least from it. kNoneShown where the
// contours of that frame may lie elsewhere.
cv::Mat1b framesShownBy(const cv::Mat3f& picture, const ObservedBracket& bracket) {
  cv::Mat1b shown(picture.size(), kNoneShown);
  cv::Mat1f least(picture.size(), std::numeric_limits<float>::max());
  for (std::size_t k = 0; k < bracket.frames.size(); ++k) {
    const ObservedFrame& frame = bracket.frames[k];
    cv::Mat3f codes;
    frame.codes.convertTo(codes, CV_32F, 1.0 / kCodeScale);
    codes -= picture;
    const cv::Mat1f difference = meanSquares(codes, kRestoration.shown_sigma);
    cv::Mat is_nearer = difference < least;
    is_nearer &= frame.shown;
    difference.copyTo(least, is_nearer);
    shown.setTo(frame.is_exact ? static_cast<int>(k) : kNoneShown, is_nearer);
  }
  return shown;
}

// How much of a correction to keep. None is kept where the depth is wrong. It may have taken a thin near
// thing for what lies behind it. Then the equations remove that thing, and all frames seem to agree. But the
// frame that the given picture shows there is sharp, and such a depth foretells that it is blurred, whether
// the picture is corrected or not. before, after: errors of that frame by the given and the corrected
// picture.
cv::Mat1f shareWhereDepthIsRight(const cv::Mat3f& given, const cv::Mat1f& before, const cv::Mat1f& after,
                                 double noise_variance) {
  cv::Mat1f unexplained(cv::max(cv::min(before, after) - 3 * noise_variance, 0));
  cv::GaussianBlur(unexplained, unexplained, {}, kRestoration.error_sigma);
  cv::Mat3f detail;
  cv::GaussianBlur(given, detail, {}, kRestoration.detail_sigma);
  cv::subtract(given, detail, detail);
  const cv::Mat1f contrast = meanSquares(detail, kRestoration.error_sigma);
  const cv::Mat1f measure(unexplained / (contrast + kRestoration.least_contrast));
  return cv::Mat1f(cv::max(
      cv::min((kRestoration.wrong - measure) / (kRestoration.wrong - kRestoration.unexplained), 1), 0));
}

// Multiplies a correction by a share for each pixel. Returns which share of its squares is kept, 0..1.
double keep(const cv::Mat1f& share, cv::Mat3f& correction) {
  double all = 0, kept = 0;
  for (int y = 0; y < share.rows; ++y) {
    for (int x = 0; x < share.cols; ++x) {
      const double size = cv::norm(correction(y, x), cv::NORM_L2SQR);
      all += size;
      kept += share(y, x) * size;
      correction(y, x) *= share(y, x);
    }
  }
  return all > 0 ? kept / all : 1;
}

ObservedBracket turnedRound(const ObservedBracket& bracket) {
  ObservedBracket turned = bracket;
  const double sum = bracket.frames.front().blur.inverse_depth + bracket.frames.back().blur.inverse_depth;
  for (ObservedFrame& frame : turned.frames)
    frame.blur = frame.blur.focusedAt(sum - frame.blur.inverse_depth);
  std::reverse(turned.frames.begin(), turned.frames.end());
  return turned;
}

// Standard deviations by which errors rise from one picture to another.
double deviationsOfRise(const cv::Mat1f& before, const cv::Mat1f& after) {
  const cv::Size size(std::max(1, before.cols / kRestoration.order_tile),
                      std::max(1, before.rows / kRestoration.order_tile));
  cv::Mat1f tiles;
  cv::resize(after - before, tiles, size, 0, 0, cv::INTER_AREA);
  const double deviation = cv::norm(tiles);
  return deviation > 0 ? cv::sum(tiles)[0] / deviation : 0;
}

// A bracket without measured depth in one of the two orders of near and far.
struct OrderedBracket {
  ObservedBracket observed;  // its filled depth is that which explains the frames
  bool turned = false;
  cv::Mat1f inverse_depth = {};  // the same, with contours that were moved once
};

// Blur alone does not tell near from far where no depth was measured: what lies as far before the focus as
// something else behind it looks alike. But near things cover far ones. So of both orders that one counts
// which explains the frames better, once its contours lie where they should. Where nothing tells, the focus
// distances that were given are right, or the first frame is the nearest, as cameras take brackets by
// themselves. Empty: progress said stop.
std::optional<OrderedBracket> orderByOcclusion(const ObservedBracket& given,
                                               std::unique_ptr<BlurredPictures> pictures,
                                               const InverseDepthRange& range, bool order_known,
                                               const BracketRestoration::Progress& proceed) {
  std::array<OrderedBracket, 2> both = {{{given, false}, {turnedRound(given), true}}};
  std::array<cv::Mat1f, 2> errors;
  const float gap = given.gap(kRestoration.occlusion);
  cv::Mat1b beside(given.fused.size(), 0);
  for (auto& [bracket, turned, inverse_depth] : both) {
    // Without outliers, which nobody contradicts.
    cv::medianBlur(depthFromBracket(bracket, *pictures, range), bracket.filled, 5);
    inverse_depth = bracket.filled.clone();
    cv::bitwise_or(beside, besideJumps(inverse_depth, gap, kRestoration.beside), beside);
    if (!proceed(0)) return std::nullopt;
  }
  pictures.reset();  // by far the largest part of memory
  for (std::size_t i = 0; i < both.size(); ++i) {
    auto& [bracket, turned, inverse_depth] = both[i];
    std::vector<ImageFormation> formation = formationOf(bracket, inverse_depth);
    const auto half = [&](double done) { return proceed(0.5 * (static_cast<double>(i) + done)); };
    if (!moveContours(bracket, formation, inverse_depth, kRestoration.stiffness[0], half))
      return std::nullopt;
    errors[i] = errorsOfAll(bracket, formation, bracket.light, beside);
  }
  const double turned_is_worse = deviationsOfRise(errors[0], errors[1]);
  bool turned = turned_is_worse < kRestoration.order;
  if (order_known) {
    turned = turned_is_worse < -kRestoration.order &&
             cv::sum(errors[1])[0] < kRestoration.turned * cv::sum(errors[0])[0];
  }
  return both[turned ? 1 : 0];
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
  scene_ = scene;
  size_ = working_size_ = {};
  focus_known_ = linear_ = false;
  held_.clear();
}

void BracketRestoration::add(const AlignedFrame& frame) {
  size_ = frame.image.size();
  const bool known = !std::isnan(frame.focus_mm);
  if (focus_known_ && !known) return;
  if (known && !focus_known_) held_.clear();  // their steps were a guess
  focus_known_ = known;
  if (held_.empty()) working_size_ = workingSize(scene_, size_);
  HeldFrame held;
  held.image = downsampled(toEightBits(frame.image), working_size_);
  cv::Mat1b shown(size_, 0);
  shown(frame.seen).setTo(255);
  if (!frame.opaque.empty()) shown.setTo(0, frame.opaque == 0);
  held.shown = downsampled(shown, working_size_) == 255;
  held.gain = frame.gain;
  held.inverse_depth = known ? 1 / frame.focus_mm : 1 + frame.index;
  held.index = frame.index;
  linear_ = frame.linear;
  // Of equal distances, as a list has that is late by a frame, in the order of the bracket.
  const bool comes_nearer = held_.empty() || held_.front().index < held_.back().index;
  const auto place = std::upper_bound(held_.begin(), held_.end(), held,
                                      [comes_nearer](const HeldFrame& a, const HeldFrame& b) {
                                        if (a.inverse_depth != b.inverse_depth)
                                          return a.inverse_depth < b.inverse_depth;
                                        return comes_nearer ? a.index < b.index : b.index < a.index;
                                      });
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
  if (held_.size() < 2) return "two frames at different distances are needed";
  if (held_.front().inverse_depth == held_.back().inverse_depth)
    return "all frames are focused at the same distance";
  return "";
}

// Tells the user what the frames say about the lens.
void BracketRestoration::tell(const LensFit& fit, RestorationResult& result) const {
  if (!fit.shows_blur) {
    if (!hasScale()) result.refusal = "the frames hardly differ in blur, and no lens is known";
    return;
  }
  if (hasScale()) result.blur_scale = fit.scale;
  if (fit.contradicts()) {
    result.refusal = cv::format("the best lens %s explains only %.0f %% of the blur in the frames",
                                hasScale() ? "with these focus distances" : "that is moved in even steps",
                                100 * std::max(0.0, fit.explained));
    return;
  }
  if (hasScale()) result.notes = fit.notes(scene_.optics);
}

double BracketRestoration::shrinking() const {
  return BlurEvidence::shrinking(working_size_, kRestoration.copy_pixels);
}

// All pictures in one size and one exposure, with the lens that was given.
ObservedBracket BracketRestoration::observed(const cv::Mat& fused, std::optional<int> exact) const {
  ObservedBracket bracket;
  bracket.fused = downsampled(toEightBits(fused), working_size_);
  bracket.curve = linear_ ? &LightCurve::linear() : &LightCurve::srgb();
  bracket.light = linearLight(bracket.fused, *bracket.curve);
  const double span = held_.back().inverse_depth - held_.front().inverse_depth;
  for (const HeldFrame& held : held_) {
    const FrameBlur blur =
        hasScale() ? blurOf(scene_, held.inverse_depth, working_size_.width)
                   : FrameBlur{held.inverse_depth, kRestoration.guessed_blur * shrinking() / span};
    bracket.frames.push_back(
        {exposed(held.image, held.gain, *bracket.curve), held.shown, blur, !exact || held.index == *exact});
  }
  bracket.noise_variance = noiseVariance(images());
  if (!scene_.depth.empty() && focus_known_) {
    bracket.filled = inverseDepthOf(scene_.depth, working_size_);
    bracket.measured =
        scene_.measured.empty() ? bracket.filled.clone() : inverseDepthOf(scene_.measured, working_size_);
  }
  return bracket;
}

std::vector<cv::Mat> BracketRestoration::images() const {
  std::vector<cv::Mat> images;
  images.reserve(held_.size());
  for (const HeldFrame& held : held_) images.push_back(held.image);
  return images;
}

// Of the frames that are held, in their order.
FocusVotes BracketRestoration::votes() const {
  if (!scene_.camera || scene_.depth.empty()) return {{}, {}, {}};
  const LightCurve& curve = linear_ ? LightCurve::linear() : LightCurve::srgb();
  std::vector<FocusVotes::Frame> details;
  for (const HeldFrame& held : held_) {
    cv::Mat codes, gray;
    exposed(held.image, held.gain, curve).convertTo(codes, CV_8U, 1.0 / kCodeScale);
    cv::cvtColor(codes, gray, cv::COLOR_BGR2GRAY);
    details.push_back({DetailMap::of(gray)});
  }
  return {details, scene_.measured.empty() ? scene_.depth : scene_.measured, working_size_};
}

bool BracketRestoration::findFocus() {
  if (focus_known_) return false;
  std::vector<double> steps;
  for (const HeldFrame& held : held_) steps.push_back(held.inverse_depth);
  const std::vector<double> focus = votes().focusAt(steps);
  if (focus.empty() || 1 / scene_.optics.focal_length_mm <= std::max(focus.front(), focus.back()))
    return false;
  for (std::size_t k = 0; k < focus.size(); ++k) held_[k].inverse_depth = std::max(focus[k], 0.0);
  if (focus.front() > focus.back()) std::reverse(held_.begin(), held_.end());
  focus_known_ = true;
  return true;
}

// What the frames say about lens and focus distances; those are in the order of inverse distance.
LensFit BracketRestoration::lens(const ObservedBracket& bracket) const {
  const std::vector<FrameBlur> given = blurOf(bracket, 1);
  const BlurEvidence evidence = evidenceOf(bracket, shrinking());
  if (const auto voted = focus_known_ ? votes().correctionOf(given) : std::nullopt) {
    const LensFit fit = fitLens(evidence, given, voted, hasScale());
    if (!fit.contradicts()) return fit;
  }
  return fitWrongLens(evidence, given, hasScale());
}

std::optional<RestorationResult> BracketRestoration::restore(const cv::Mat& fused, const Progress& progress,
                                                             std::optional<int> exact) const {
  const auto proceed = [&](double done) { return !progress || progress(done); };
  const auto part = [&](double from, double to) {
    return [&proceed, from, to](double done) { return proceed(from + done * (to - from)); };
  };
  if (!proceed(0)) return std::nullopt;

  // 1. All pictures in one size and one exposure.
  ObservedBracket bracket = observed(fused, exact);
  if (!proceed(0.05)) return std::nullopt;

  // 2. What the frames say about the lens and its focus distances.
  RestorationResult result;
  const LensFit found = lens(bracket);
  tell(found, result);
  if (!result.refusal.empty()) return result;
  correct(found, bracket);
  const bool has_depth = !bracket.filled.empty();
  const InverseDepthRange range = rangeOf(bracket);
  if (has_depth) {
    cut(range, bracket.filled);
    cut(range, bracket.measured);
  }
  auto pictures =
      std::make_unique<BlurredPictures>(bracket.light, *bracket.curve, largestRadius(bracket, range));
  if (!proceed(0.2)) return std::nullopt;

  // 3. The depth map that explains the frames.
  cv::Mat1f inverse_depth;
  if (has_depth) {
    inverse_depth = depthFromBracket(bracket, *pictures, range);
    pictures.reset();  // by far the largest part of memory
  } else {
    const std::optional<OrderedBracket> ordered =
        orderByOcclusion(bracket, std::move(pictures), range, focus_known_, part(0.3, 0.4));
    if (!ordered) return std::nullopt;
    if (ordered->turned && focus_known_) {
      LensFit turned;
      turned.focus.reversed = true;
      for (std::string& note : turned.notes(scene_.optics)) result.notes.push_back(note);
    }
    bracket = ordered->observed;
    inverse_depth = ordered->inverse_depth;
  }
  if (!proceed(0.4)) return std::nullopt;

  // 4. Its contours to the pixel, and the sharp picture that explains the frames better than the fused one;
  // twice, because the blur that the fused picture shows beside near objects misleads contours.
  std::vector<ImageFormation> formation = formationOf(bracket, inverse_depth);
  const cv::Mat3f given_light = bracket.light;
  const cv::Mat3b given = bracket.fused;
  cv::Mat3f sum(given.size(), cv::Vec3f::all(0));
  double from = 0.4;
  for (const float stiffness : kRestoration.stiffness) {
    const bool has_moved = !has_depth && stiffness == kRestoration.stiffness[0];  // by orderByOcclusion()
    if (!has_moved && !moveContours(bracket, formation, inverse_depth, stiffness, part(from, from + 0.15)))
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

  // 5. Does the depth explain what the given picture shows?
  cv::Mat3f given_codes;
  given.convertTo(given_codes, CV_32F);
  cv::Mat1b source = framesShownBy(given_codes, bracket);
  cv::Mat unchanged;
  cv::inRange(sum, cv::Scalar(), cv::Scalar(), unchanged);
  source.setTo(kNoneShown, unchanged);
  const cv::Mat1f before = errorsOf(source, bracket, formation, given_light);
  const cv::Mat1f after = errorsOf(source, bracket, formation, bracket.light);
  result.kept = keep(shareWhereDepthIsRight(given_codes, before, after, bracket.noise_variance), sum);
  if (!linear_ && !exact) keepDark(given, sum);
  keepLights(given, images(), sum);
  if (result.kept < kRestoration.told_share) {
    result.notes.push_back(cv::format(
        "%.0f %% of the restoration is kept: elsewhere the frames do not show it", 100 * result.kept));
  }
  result.image = fused.clone();
  addTo(result.image, sum);
  if (focus_known_) result.depth = depthOf(inverse_depth, size_);
  proceed(1);
  return result;
}

}  // namespace all_in_focus::core
