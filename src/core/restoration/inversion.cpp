// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/inversion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>

#include "restoration/light.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kBandJumpPx = 0.75;  // of blur; smaller jumps leave little to correct
constexpr int kBandPx = 5;            // about them
constexpr double kBandSigma = 1.5;
constexpr int kSolvedPx = kBandPx + 2;
constexpr float kSharpPx = 2.5f;                             // radius of frames that tell
constexpr int kFarthestPart = 4;                             // px; parts farther away count as known
constexpr double kModelVariance = 0.49, kModelError = 0.09;  // gray levels squared; by squared radius
constexpr double kPriorShare = 0.49, kLeastVariance = 0.1;
constexpr float kSmoothness = 0.1f;
constexpr double kResidualSigma = 2;  // px
constexpr int kSteps = 3;             // of conjugate gradients
constexpr float kSpreadMargin = 2;    // gray levels
constexpr float kGateFrom = 0.1f, kGateTo = 0.4f;
// Of the correction: contours and lens model are wrong here and there, and what is corrected too much costs
// more than what is corrected too little.
constexpr float kTaken = 0.9f;
constexpr int kStripRows = 16;

cv::Mat1b neighbourhood(const cv::Mat1b& mask, int reach) {
  cv::Mat1b wide;
  cv::dilate(mask, wide, cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * reach + 1, 2 * reach + 1}));
  return wide;
}

// One pixel of one frame.
struct Row {
  std::int16_t x, y;
  float weight;                // omega
  cv::Vec3f residual;          // of the fused picture, gray levels
  cv::Vec3f slope;             // d code / d light
  std::uint32_t first, count;  // its parts
};

// Small, for there are millions.
struct Part {
  std::int8_t dx, dy;
  std::uint16_t share;  // times kWholeShare
};
constexpr float kWholeShare = 65535;

// Rows of the equations of a strip of the picture.
struct Strip {
  std::vector<Row> rows;
  std::vector<Part> parts;
};

class Equations {
 public:
  Equations(const ObservedBracket& bracket, const std::vector<ImageFormation>& formation,
            const cv::Mat1b& solved)
      : bracket_(bracket), solved_(solved), strips_({0, solved.rows}, std::max(1, solved.rows / kStripRows)) {
    equations_.resize(strips_.count());
    strips_.forEach([&](const cv::Range& rows, int i) { build(formation, rows, equations_[i]); });
    slopes_.create(solved.size());
    const LightCurve& curve = LightCurve::get();
    for (int y = 0; y < solved.rows; ++y) {
      for (int x = 0; x < solved.cols; ++x) {
        for (int c = 0; c < 3; ++c) slopes_(y, x)[c] = 1 / curve.slope(bracket.fused(y, x)[c]);
      }
    }
  }

  // work(row, parts) for all rows, strips at the same time.
  template <typename Work>
  void forEach(const Work& work) const {
    strips_.forEach([&](const cv::Range&, int i) {
      for (const Row& row : equations_[i].rows) work(row, equations_[i].parts.data() + row.first);
    });
  }

  // A z of a row, gray levels. light: z in linear light.
  static cv::Vec3f predicted(const Row& row, const Part* parts, const cv::Mat4f& light) {
    const cv::Vec4f* here = &light(row.y, row.x);
    const auto stride = static_cast<std::ptrdiff_t>(light.step1() / 4);
    cv::v_float32x4 sum = cv::v_setzero_f32();
    for (std::uint32_t i = 0; i < row.count; ++i)
      sum += cv::v_load(here[parts[i].dy * stride + parts[i].dx].val) *
             cv::v_setall_f32(static_cast<float>(parts[i].share));
    cv::Vec4f light_sum;
    cv::v_store(light_sum.val, sum);
    return cv::Vec3f(light_sum.val).mul(row.slope) * (1 / kWholeShare);
  }

  // out = A^T omega values(row, parts), by pixel.
  template <typename Values>
  void transposed(const Values& values, cv::Mat3f& out) const {
    spread(
        [&](const Row& row, const Part* parts) { return (row.weight * values(row, parts)).mul(row.slope); },
        [](float share) { return share; }, out);
    out = out.mul(slopes_);
  }

  // Diagonal of A^T omega A.
  cv::Mat3f diagonal() const {
    cv::Mat3f out(solved_.size());
    spread([&](const Row& row, const Part*) { return row.weight * row.slope.mul(row.slope); },
           [](float share) { return share * share; }, out);
    return out.mul(slopes_).mul(slopes_);
  }

  cv::Mat4f toLight(const cv::Mat3f& z) const {
    cv::Mat4f light(z.size());
    for (int y = 0; y < z.rows; ++y) {
      for (int x = 0; x < z.cols; ++x) {
        const cv::Vec3f here = z(y, x).mul(slopes_(y, x));
        light(y, x) = {here[0], here[1], here[2], 0};
      }
    }
    return light;
  }
  const cv::Mat1b& solved() const { return solved_; }

 private:
  void build(const std::vector<ImageFormation>& formation, const cv::Range& rows, Strip& strip) const {
    const LightCurve& curve = LightCurve::get();
    std::vector<ImageFormation::Part> parts;
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < solved_.cols; ++x) {
        if (!solved_(y, x)) continue;
        for (size_t k = 0; k < formation.size(); ++k) {
          const ObservedFrame& frame = bracket_.frames[k];
          const float radius = formation[k].radius({x, y});
          if (radius >= kSharpPx || !frame.seen.contains({x, y})) continue;
          formation[k].partsOf({x, y}, formation[k].inverseDepth({x, y}), parts);
          Row row;
          row.x = static_cast<std::int16_t>(x);
          row.y = static_cast<std::int16_t>(y);
          row.weight = static_cast<float>(
              1 / (bracket_.noise_variance + kModelVariance + kModelError * radius * radius));
          row.first = static_cast<std::uint32_t>(strip.parts.size());
          cv::Vec3f light;
          for (const ImageFormation::Part& part : parts) {
            light += part.share * bracket_.light(y + part.dy, x + part.dx);
            if (std::max(std::abs(part.dx), std::abs(part.dy)) <= kFarthestPart &&
                solved_(y + part.dy, x + part.dx))
              strip.parts.push_back({static_cast<std::int8_t>(part.dx), static_cast<std::int8_t>(part.dy),
                                     static_cast<std::uint16_t>(part.share * kWholeShare + 0.5f)});
          }
          row.count = static_cast<std::uint32_t>(strip.parts.size()) - row.first;
          for (int c = 0; c < 3; ++c) {
            const float code = curve.code(light[c]);
            row.residual[c] = static_cast<float>(frame.codes(y, x)[c]) / kCodeScale - code;
            row.slope[c] = curve.slope(code);
          }
          strip.rows.push_back(row);
        }
      }
    }
    strip.parts.shrink_to_fit();
    strip.rows.shrink_to_fit();
  }

  // out = sum over rows of factor(share) value(row): each strip into rows of its own, which are then added in
  // their order, so that the sum does not depend on the number of threads.
  template <typename Value, typename Factor>
  void spread(const Value& value, const Factor& factor, cv::Mat3f& out) const {
    std::vector<cv::Mat4f> sums(strips_.count());
    const std::ptrdiff_t stride = solved_.cols;
    strips_.forEach([&](const cv::Range& rows, int i) {
      sums[i] = cv::Mat4f::zeros(rows.size() + 2 * kFarthestPart, solved_.cols);
      for (const Row& row : equations_[i].rows) {
        const Part* parts = equations_[i].parts.data() + row.first;
        const cv::Vec3f wanted = value(row, parts);
        const cv::v_float32x4 here(wanted[0], wanted[1], wanted[2], 0);
        cv::Vec4f* to = &sums[i](row.y - rows.start + kFarthestPart, row.x);
        for (std::uint32_t k = 0; k < row.count; ++k) {
          float* sum = to[parts[k].dy * stride + parts[k].dx].val;
          const float share = factor(static_cast<float>(parts[k].share) * (1 / kWholeShare));
          cv::v_store(sum, cv::v_load(sum) + here * cv::v_setall_f32(share));
        }
      }
    });
    out.create(solved_.size());
    out.setTo(cv::Scalar());
    for (int i = 0; i < strips_.count(); ++i) {
      const cv::Range rows = strips_[i];
      const int top = std::max(0, rows.start - kFarthestPart),
                bottom = std::min(out.rows, rows.end + kFarthestPart);
      for (int y = top; y < bottom; ++y) {
        const cv::Vec4f* from = sums[i][y - rows.start + kFarthestPart];
        for (int x = 0; x < out.cols; ++x) out(y, x) += cv::Vec3f(from[x].val);
      }
    }
  }

  const ObservedBracket& bracket_;
  cv::Mat1b solved_;
  RowStrips strips_;
  std::vector<Strip> equations_;
  cv::Mat3f slopes_;  // d light / d code of the fused picture
};

cv::Vec3f squared(const cv::Vec3f& v) {
  return v.mul(v);
}

float mean(const cv::Vec3f& v) {
  return (v[0] + v[1] + v[2]) / 3;
}

// Squared residuals of the frames by pixel, mean over channels, weighted by omega, smoothed; and the weights.
struct Residuals {
  cv::Mat1f sum, weight, noise;
};

// z: in light; empty = none.
Residuals residuals(const Equations& equations, const cv::Mat4f& light, double noise_variance) {
  Residuals found;
  for (cv::Mat1f* image : {&found.sum, &found.weight, &found.noise})
    *image = cv::Mat1f::zeros(equations.solved().size());
  equations.forEach([&](const Row& row, const Part* parts) {
    const cv::Vec3f left =
        light.empty() ? row.residual : row.residual - Equations::predicted(row, parts, light);
    found.sum(row.y, row.x) += row.weight * mean(squared(left));
    found.weight(row.y, row.x) += row.weight;
    found.noise(row.y, row.x) += row.weight * static_cast<float>(noise_variance);
  });
  for (cv::Mat1f* image : {&found.sum, &found.weight, &found.noise})
    cv::GaussianBlur(*image, *image, {}, kResidualSigma);
  return found;
}

// 1 / s^2.
cv::Mat1f priorOf(const Residuals& before, double noise_variance) {
  cv::Mat1f prior(before.sum.size());
  for (int y = 0; y < prior.rows; ++y) {
    for (int x = 0; x < prior.cols; ++x) {
      const float weight = std::max(before.weight(y, x), 1e-6f);
      const float excess = std::max(0.0f, (before.sum(y, x) - before.noise(y, x)) / weight);
      prior(y, x) = 1 / (static_cast<float>(kPriorShare * (noise_variance + kLeastVariance)) + excess);
    }
  }
  return prior;
}

// (A^T omega A + 1 / s^2 + smoothness) z
void apply(const Equations& equations, const cv::Mat1f& prior, const cv::Mat3f& z, cv::Mat3f& out) {
  const cv::Mat4f light = equations.toLight(z);
  equations.transposed(
      [&](const Row& row, const Part* parts) { return Equations::predicted(row, parts, light); }, out);
  const cv::Mat1b& solved = equations.solved();
  for (int y = 0; y < z.rows; ++y) {
    for (int x = 0; x < z.cols; ++x) {
      if (!solved(y, x)) continue;
      const cv::Vec3f& here = z(y, x);
      cv::Vec3f bend;
      for (const cv::Point& step : {cv::Point(-1, 0), cv::Point(1, 0), cv::Point(0, -1), cv::Point(0, 1)}) {
        const cv::Point q = cv::Point(x, y) + step;
        if (q.x >= 0 && q.y >= 0 && q.x < z.cols && q.y < z.rows) bend += here - z(q);
      }
      out(y, x) += prior(y, x) * here + kSmoothness * bend;
    }
  }
}

cv::Vec3d dot(const cv::Mat3f& a, const cv::Mat3f& b) {
  const cv::Scalar sums = cv::sum(a.mul(b));
  return {sums[0], sums[1], sums[2]};
}

void addScaled(cv::Mat3f& to, const cv::Mat3f& from, const cv::Vec3d& factor) {
  const cv::Vec3f f(factor);
  cv::parallel_for_({0, to.rows}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < to.cols; ++x) to(y, x) += f.mul(from(y, x));
    }
  });
}

cv::Vec3d ratio(const cv::Vec3d& a, const cv::Vec3d& b) {
  cv::Vec3d r;
  for (int c = 0; c < 3; ++c) r[c] = b[c] > 0 ? a[c] / b[c] : 0;
  return r;
}

// Conjugate gradients, preconditioned by the diagonal; channels on their own.
std::optional<cv::Mat3f> solve(const Equations& equations, const cv::Mat1f& prior,
                               const std::function<bool(double)>& proceed) {
  cv::Mat3f residual, z = cv::Mat3f::zeros(prior.size()), product;
  equations.transposed([](const Row& row, const Part*) { return row.residual; }, residual);
  cv::Mat3f inverse = equations.diagonal();
  for (int y = 0; y < z.rows; ++y) {
    for (int x = 0; x < z.cols; ++x) {
      for (int c = 0; c < 3; ++c) inverse(y, x)[c] = 1 / (inverse(y, x)[c] + prior(y, x) + 4 * kSmoothness);
    }
  }
  residual.setTo(cv::Scalar(), equations.solved() == 0);
  cv::Mat3f steepest = residual.mul(inverse), direction = steepest.clone();
  cv::Vec3d energy = dot(residual, steepest);
  for (int i = 0; i < kSteps; ++i) {
    if (!proceed(static_cast<double>(i) / kSteps)) return std::nullopt;
    apply(equations, prior, direction, product);
    const cv::Vec3d length = ratio(energy, dot(direction, product));
    addScaled(z, direction, length);
    addScaled(residual, product, -length);
    steepest = residual.mul(inverse);
    const cv::Vec3d next = dot(residual, steepest);
    const cv::Vec3d turn = ratio(next, energy);
    for (int y = 0; y < z.rows; ++y) {
      for (int x = 0; x < z.cols; ++x)
        direction(y, x) = steepest(y, x) + cv::Vec3f(turn).mul(direction(y, x));
    }
    energy = next;
  }
  return z;
}

// |z| is at most what the frames differ by there; its colour stays.
void limit(const ObservedBracket& bracket, cv::Mat3f& z) {
  for (int y = 0; y < z.rows; ++y) {
    for (int x = 0; x < z.cols; ++x) {
      cv::Vec3f& here = z(y, x);
      if (here == cv::Vec3f()) continue;
      cv::Vec3s least = bracket.frames[0].codes(y, x), most = least;
      for (const ObservedFrame& frame : bracket.frames) {
        for (int c = 0; c < 3; ++c) {
          least[c] = std::min(least[c], frame.codes(y, x)[c]);
          most[c] = std::max(most[c], frame.codes(y, x)[c]);
        }
      }
      float factor = 1;
      for (int c = 0; c < 3; ++c) {
        const float spread = static_cast<float>(most[c] - least[c]) / kCodeScale + kSpreadMargin;
        if (std::abs(here[c]) > spread) factor = std::min(factor, spread / std::abs(here[c]));
      }
      here *= factor;
    }
  }
}

// By the share of the residual in excess of noise that z explains.
void gate(const Residuals& before, const Residuals& after, cv::Mat3f& z) {
  for (int y = 0; y < z.rows; ++y) {
    for (int x = 0; x < z.cols; ++x) {
      const float excess =
          std::max(before.sum(y, x) - before.noise(y, x), 1e-3f * before.weight(y, x) + 1e-9f);
      const float share = (before.sum(y, x) - after.sum(y, x)) / excess;
      z(y, x) *= kTaken * std::clamp((share - kGateFrom) / (kGateTo - kGateFrom), 0.0f, 1.0f);
    }
  }
}

}  // namespace

std::optional<cv::Mat3f> correction(const ObservedBracket& bracket,
                                    const std::vector<ImageFormation>& formation,
                                    const cv::Mat1f& inverse_depth,
                                    const std::function<bool(double)>& proceed) {
  const cv::Mat1b edges = jumps(inverse_depth, bracket.gap(kBandJumpPx));
  if (cv::countNonZero(edges) == 0) return cv::Mat3f(cv::Mat3f::zeros(inverse_depth.size()));
  const Equations equations(bracket, formation, neighbourhood(edges, kSolvedPx));
  if (!proceed(0.4)) return std::nullopt;
  const Residuals before = residuals(equations, {}, bracket.noise_variance);
  std::optional<cv::Mat3f> z = solve(equations, priorOf(before, bracket.noise_variance),
                                     [&](double done) { return proceed(0.4 + 0.5 * done); });
  if (!z) return z;
  limit(bracket, *z);
  gate(before, residuals(equations, equations.toLight(*z), bracket.noise_variance), *z);
  cv::Mat1f band;
  neighbourhood(edges, kBandPx).convertTo(band, CV_32F, 1 / 255.0);
  cv::GaussianBlur(band, band, {}, kBandSigma);
  for (int y = 0; y < band.rows; ++y) {
    for (int x = 0; x < band.cols; ++x) (*z)(y, x) *= band(y, x);
  }
  return z;
}

}  // namespace all_in_focus::core
