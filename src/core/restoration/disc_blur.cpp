// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/disc_blur.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "restoration/observed_bracket.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kSamples = 16;            // along each axis of a pixel that the rim of a disc crosses
constexpr float kSmallKernelPx = 2.6f;  // up to there plain convolution is quicker

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

// out[i] += share (sum of the pixels within half of pixel i), from the row's running sums: ends of half
// pixels count in part.
ALL_IN_FOCUS_SIMD void addChord(const float* left, const float* right, float fraction, int n, float* out) {
  constexpr int kNext = 3;  // channels
  for (int i = 0; i < n; ++i) {
    const float whole = right[i] - left[i];
    const float more = right[i + kNext] - left[i - kNext];
    out[i] += whole + fraction * (more - whole);
  }
}

// A row with its mirror images on both sides as running sums of each channel.
void sumRow(const cv::Vec3f* row, int cols, int pad, std::vector<float>& sums) {
  sums.resize(3 * (static_cast<size_t>(cols) + 2 * pad + 1));
  cv::Vec3f sum;
  for (int x = -pad; x < cols + pad; ++x) {
    float* at = &sums[3 * static_cast<size_t>(x + pad)];
    std::copy_n(sum.val, 3, at);
    sum += row[cv::borderInterpolate(x, cols, cv::BORDER_REFLECT_101)];
  }
  std::copy_n(sum.val, 3, sums.end() - 3);
}

void blurByChords(const cv::Mat& image, double radius, cv::Mat& out) {
  out.create(image.size(), image.type());
  const int reach = static_cast<int>(std::ceil(radius - 0.5));
  std::vector<double> half(reach + 1);  // half chord, mean over the pixel row
  double area = 0;
  for (int dy = 0; dy <= reach; ++dy) {
    for (int i = 0; i < kSamples; ++i) {
      const double y = dy - 0.5 + (i + 0.5) / kSamples;
      half[dy] += std::sqrt(std::max(0.0, radius * radius - y * y)) / kSamples;
    }
    area += (dy ? 4 : 2) * half[dy];
  }
  const int pad = static_cast<int>(std::ceil(radius)) + 2;
  const RowStrips strips({0, image.rows}, stripCount(image.rows));
  strips.forEach([&](const cv::Range& rows, int) {
    const int kept = 2 * reach + 1;
    std::vector<std::vector<float>> sums(kept);
    const auto summed = [&](int y) -> std::vector<float>& { return sums[(y + kept * 2) % kept]; };
    const auto compute = [&](int y) {
      sumRow(image.ptr<cv::Vec3f>(cv::borderInterpolate(y, image.rows, cv::BORDER_REFLECT_101)), image.cols,
             pad, summed(y));
    };
    for (int y = rows.start - reach; y < rows.start + reach; ++y) compute(y);
    for (int y = rows.start; y < rows.end; ++y) {
      compute(y + reach);
      float* to = out.ptr<float>(y);
      std::fill_n(to, 3 * image.cols, 0.0f);
      for (int dy = -reach; dy <= reach; ++dy) {
        // Pixel x covers x - 0.5 .. x + 0.5; sums[i] ends before pixel i - pad.
        const double end = half[std::abs(dy)] + 0.5;
        const int whole = static_cast<int>(end);
        const float* middle = summed(y + dy).data() + 3 * static_cast<size_t>(pad);
        addChord(middle + 3 * (1 - whole), middle + 3 * whole, static_cast<float>(end - whole),
                 3 * image.cols, to);
      }
      const float scale = static_cast<float>(1 / area);
      for (int i = 0; i < 3 * image.cols; ++i) to[i] *= scale;
    }
  });
}

}  // namespace

DiscKernels::DiscKernels() {
  const int count = kLargestPx * kStepsPerPx + 1;
  shares_.resize(static_cast<size_t>(count) * kSide * kSide);
  reach_.resize(count);
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
        sum += share * (dx ? 2 : 1) * (dy ? 2 : 1) * (dx != dy ? 2 : 1);
        if (share > 0) reach_[i] = std::max(reach_[i], dx);
      }
    }
    for (int k = 0; k < kSide * kSide; ++k) shares[k] /= static_cast<float>(sum);
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

void blurByDisc(const cv::Mat& image, float radius, cv::Mat& out) {
  const int index = DiscKernels::index(radius);
  const DiscKernels& kernels = DiscKernels::get();
  if (radius > kSmallKernelPx) return blurByChords(image, radius, out);
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
    forEachRow(light.rows, [&](int y) {
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
