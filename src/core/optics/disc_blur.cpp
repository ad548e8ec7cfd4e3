// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "optics/disc_blur.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kSamples = 16;  // along each axis of a pixel that the rim of a disc crosses

// Radii of BlurredPictures.
constexpr float kFineStep = 0.25f, kCoarseStep = 0.5f;  // px
constexpr int kFineSteps = 16;                          // then coarse: wide discs differ less
constexpr float kFineEnd = kFineSteps * kFineStep;

float radiusOf(int index) {
  const auto fine = static_cast<float>(std::min(index, kFineSteps)),
             coarse = static_cast<float>(index) - fine;
  return kFineStep * fine + kCoarseStep * coarse;
}

// Share of pixel (dx, dy) that a disc of this radius about (0, 0) covers.
double coverage(double radius, int dx, int dy) {
  const double farthest = std::hypot(dx + 0.5, dy + 0.5);
  if (farthest <= radius) return 1;
  const double nearest = std::hypot(std::max(0.0, dx - 0.5), std::max(0.0, dy - 0.5));
  if (nearest >= radius) return 0;
  int inside = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double y = dy - 0.5 + (i + 0.5) / kSamples;
    for (int j = 0; j < kSamples; ++j) {
      const double x = dx - 0.5 + (j + 0.5) / kSamples;
      inside += x * x + y * y <= radius * radius;
    }
  }
  return inside / static_cast<double>(kSamples * kSamples);
}

}  // namespace

FrameBlur frameBlur(const Optics& optics, double pixel_pitch_mm, double inverse_depth) {
  const double f = optics.focal_length_mm;
  return {inverse_depth, f * f / (2 * optics.aperture * pixel_pitch_mm) / (1 - f * inverse_depth), f};
}

DiscKernels::DiscKernels() {
  const int count = kLargestPx * kStepsPerPx + 1;
  shares_.resize(static_cast<size_t>(count) * kSide * kSide);
  reach_.resize(count);
  variance_.resize(count);
  least_.assign(static_cast<size_t>(4) * kSide * kSide, 255);
  for (int i = 0; i < count; ++i) {
    // A disc that lies within its own pixel is that pixel.
    const double radius = std::max(0.5, static_cast<double>(i) / kStepsPerPx);
    float* shares = &shares_[static_cast<size_t>(i) * kSide * kSide];
    double sum = 0;
    for (int dy = 0; dy < kSide; ++dy) {
      for (int dx = dy; dx < kSide; ++dx) {
        const double share = radius <= 0.5 ? dx + dy == 0 : coverage(radius, dx, dy);
        shares[kSide * dy + dx] = shares[kSide * dx + dy] = static_cast<float>(share);
        const double sharing = share * (dx ? 2 : 1) * (dy ? 2 : 1) * (dx != dy ? 2 : 1);
        sum += sharing;
        variance_[i] += sharing * (dx * dx + dy * dy) / 2;
        if (share > 0) reach_[i] = std::max(reach_[i], dx);
      }
    }
    for (int k = 0; k < kSide * kSide; ++k) shares[k] /= static_cast<float>(sum);
    variance_[i] /= sum;
    for (int dy = 0; dy < kSide; ++dy) {
      for (int dx = 1 - kSide; dx < kSide; ++dx) {
        std::uint8_t& least = least_[4 * kSide * dy + kSide + dx];
        if (shares[kSide * dy + std::abs(dx)] > 0 && least == 255) least = static_cast<std::uint8_t>(i);
      }
    }
  }
}

const DiscKernels& DiscKernels::get() {
  static const DiscKernels kernels;
  return kernels;
}

double DiscKernels::variance(double radius) const {
  if (!(radius < kLargestPx)) return variance_.back() + (radius * radius - kLargestPx * kLargestPx) / 4;
  const double place = radius * kStepsPerPx;
  const auto below = static_cast<std::size_t>(place);
  const double share = place - static_cast<double>(below);
  return (1 - share) * variance_[below] + share * variance_[below + 1];
}

float DiscKernels::radius(double variance) const {
  if (!(variance < variance_.back()))
    return static_cast<float>(std::sqrt(kLargestPx * kLargestPx + 4 * (variance - variance_.back())));
  const auto above = std::upper_bound(variance_.begin() + 1, variance_.end(), variance);
  const auto below = above - 1;
  const double place =
      static_cast<double>(below - variance_.begin()) + (variance - *below) / (*above - *below);
  return static_cast<float>(place / kStepsPerPx);
}

void blurByDisc(const cv::Mat& image, float radius, cv::Mat& out) {
  const int index = DiscKernels::index(radius);
  const DiscKernels& kernels = DiscKernels::get();
  const int reach = kernels.reach(index);
  if (reach == 0) {
    image.copyTo(out);
    return;
  }
  cv::Mat1f kernel(2 * reach + 1, 2 * reach + 1);
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx)
      kernel(dy + reach, dx + reach) =
          kernels.shares(index)[DiscKernels::kSide * std::abs(dy) + std::abs(dx)];
  }
  cv::filter2D(image, out, -1, kernel, {-1, -1}, 0, cv::BORDER_REFLECT_101);
}

BlurredPictures::BlurredPictures(const cv::Mat3f& light, const LightCurve& curve, double largest) {
  cv::Mat blurred;
  for (int i = 0;; ++i) {
    const float radius = radiusOf(i);
    if (radius > DiscKernels::kLargestPx || (i > 0 && radius > largest + kCoarseStep / 2)) break;
    blurByDisc(light, radius, blurred);
    cv::Mat3s codes(light.size());
    inParallel(light.rows, [&](int y) {
      const float* from = blurred.ptr<float>(y);
      short* to = codes.ptr<short>(y);
      for (int k = 0; k < 3 * light.cols; ++k)
        to[k] = static_cast<short>(kCodeScale * curve.code(from[k]) + 0.5f);
    });
    codes_.push_back(codes);
  }
}

const cv::Mat3s& BlurredPictures::at(float radius) const {
  const float place =
      radius <= kFineEnd ? radius / kFineStep : kFineSteps + (radius - kFineEnd) / kCoarseStep;
  return codes_[std::min(static_cast<size_t>(place + 0.5f), codes_.size() - 1)];
}

}  // namespace all_in_focus::core
