// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/lens_check.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "all_in_focus/depth_registration.hpp"

namespace all_in_focus::core {
namespace {

// Of the copies.
constexpr double kCopyPixels = 40e3;
constexpr std::size_t kMostCopies = 12;
// Share of the blur that right numbers explain at least. Noise and blur of less than a pixel of the copies
// lower it: then other distances may seem to explain more.
constexpr double kRight = 0.5;

}  // namespace

void LensCheck::begin(const BracketScene& scene, double pixel_pitch_mm, const cv::Size& size,
                      const cv::Point2d& center) {
  scene_ = scene;
  pixel_pitch_mm_ = pixel_pitch_mm;
  size_ = size;
  center_ = center;
  shrinking_ = std::round(BlurEvidence::shrinking(size, kCopyPixels));
}

void LensCheck::observe(const cv::Mat& gray, int index, double focus_mm) {
  focus_mm_[index] = focus_mm;
  if (gray.empty() || observed_++ % step_ != 0) return;
  copies_.push_back({index, BlurEvidence::copyOf(gray, shrinking_), DetailMap::of(gray)});
  if (copies_.size() <= kMostCopies) return;
  step_ *= 2;
  std::vector<Copy> left;
  for (std::size_t i = 0; i < copies_.size(); i += 2) left.push_back(std::move(copies_[i]));
  copies_ = std::move(left);
}

void LensCheck::ask(const LightCurve& curve, const std::function<Placement(int)>& placement) {
  const std::vector<Copy> copies = std::exchange(copies_, {});
  if (copies.size() < 2) return;
  const Compared compared = compare(copies, placement);
  const std::vector<FrameBlur>& blur = compared.blur;
  if (blur.size() < 2) return;
  const std::optional<FocusCorrection> voted =
      FocusVotes(compared.details, depth(), size_).correctionOf(blur);
  if (voted && voted->reversed) {
    return refuse(
        "the frames show that the focus distances are in reverse order: depth and lens data are not used");
  }
  const BlurEvidence evidence(compared.fused, compared.frames, curve,
                              inverseDepthOf(depth(), compared.fused.size()), shrinking_);
  if ((!voted || voted->isNone()) && evidence.explained(blur, 1) >= kRight) return;

  const LensFit fit = fitLens(evidence, blur, voted, true);
  const bool is_right = fit.scale == 1 && fit.focus.isNone();
  const double least = voted && fit.scale == 1 ? kRight
                       : voted || is_right     ? LensFit::kBelieved
                                               : LensFit::kTrusted;
  const bool is_late_by_unknown = fit.focus.shift != 0 && step_ > 1;
  if (fit.explained < least || !fit.is_certain || is_late_by_unknown)
    return refuse("the frames contradict focus distances or f-number: depth and lens data are not used");
  notes_ = fit.notes(scene_.optics);
  may_predict_ = !fit.focus.reversed && (fit.focus.shift == 0 || voted);
  if (may_predict_) fit_ = fit;
}

void LensCheck::refuse(const char* reason) {
  notes_ = {reason};
  may_predict_ = false;
}

LensCheck::Compared LensCheck::compare(const std::vector<Copy>& copies,
                                       const std::function<Placement(int)>& placement) const {
  const cv::Size size = copies[0].gray.size();
  const cv::Point2d half(0.5, 0.5), copy_center = (center_ + half) / shrinking_ - half;
  const double mean = cv::mean(copies.back().gray)[0];
  Compared compared;
  compared.fused.create(size, CV_8UC1);
  cv::Mat1f sharpest(size, 0.0f), sharpness;
  for (const Copy& copy : copies) {
    const Placement place = placement(copy.index);
    if (!place.fits) continue;
    SimilarityTransform motion = place;  // in pixels of the copies
    motion.shift *= 1 / shrinking_;
    cv::Mat gray = copy.gray;
    if (!motion.isIdentity()) {
      cv::warpAffine(copy.gray, gray, motion.matrix(copy_center), size,
                     cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
    }
    const double gain = mean / std::max(1.0, cv::mean(gray)[0]);
    gray.convertTo(gray, CV_32F, gain);
    cv::Laplacian(gray, sharpness, CV_32F);
    cv::blur(cv::abs(sharpness), sharpness, {5, 5});
    const cv::Mat sharper = sharpness >= sharpest;
    cv::Mat codes;
    gray.convertTo(codes, CV_8U);
    codes.copyTo(compared.fused, sharper);
    sharpness.copyTo(sharpest, sharper);
    compared.frames.push_back({gray, seenThrough(motion, size, copy_center)});
    compared.details.push_back({copy.detail, place.matrix(center_), gain});
    compared.blur.push_back(frameBlur(scene_.optics, pixel_pitch_mm_, 1 / focus_mm_.at(copy.index)));
  }
  return compared;
}

double LensCheck::focusOf(int index) const {
  const auto here = focus_mm_.find(index);
  if (fit_.focus.isNone()) return here->second;
  double inverse = 1 / here->second;
  if (fit_.focus.shift != 0) {
    const auto behind = std::next(here), end = focus_mm_.end();
    const auto before = here == focus_mm_.begin() ? end : std::prev(here);
    const auto [from, other] = fit_.focus.shift > 0 ? std::pair(behind, before) : std::pair(before, behind);
    if (from != end) {
      inverse = 1 / from->second;
    } else if (other != end) {
      inverse += inverse - 1 / other->second;
    }
  }
  return inverse > 0 ? fit_.focus.factor / inverse : std::numeric_limits<double>::infinity();
}

}  // namespace all_in_focus::core
