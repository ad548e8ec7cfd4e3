// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/inversion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "util/row_strips.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct InversionParameters {
  // Where to correct: beside jumps of inverse depth, and where no frame is sharp.
  double band_jump = 0.75;                 // px of blur; smaller jumps leave little to correct
  int band = 5;                            // px about them
  float soft_from = 0.4f, soft_to = 0.9f;  // px: radius of the sharpest frame
  // By which frames.
  float sharp = 2.5f;  // px: radius; those that are less sharp are not used
  int soft_frames =
      3;  // at most, where no frame is sharp: whole pictures can be so (all: +0.1 dB, 3 x the time)
  // The equations. Variances are in gray levels squared.
  double model_variance = 0.49, model_error = 0.09;  // of a frame; by squared radius
  double prior_share = 0.49, least_variance = 0.1;   // of the prior: of the noise, and besides
  float smoothness = 0.1f;
  int steps = 2;               // of conjugate gradients
  float inexact_share = 0.1f;  // weight of a frame whose contours may be off, where others have 1
  // The limits of the correction.
  double residual_sigma = 2;               // px: residuals are means over that
  float gate_from = 0.1f, gate_to = 0.4f;  // share of the residual that is explained: none is kept, all
  double chance = 0.3;                     // of the variance of the noise; a smaller excess may be chance
} kInversion{};

constexpr int kFarthestPart = 4;  // px; parts farther away count as known
constexpr int kStripRows = 16;

// work(y, x) for all pixels, rows at the same time.
template <typename Work>
void forEachPixel(const cv::Size& size, const Work& work) {
  inParallel(size.height, [&](int y) {
    for (int x = 0; x < size.width; ++x) work(y, x);
  });
}

// One pixel of one frame.
struct Row {
  int x, y;
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
  // solved: how many frames a pixel takes at most; 0 = it is not solved for
  Equations(const ObservedBracket& bracket, const cv::Mat1b& solved)
      : bracket_(bracket), solved_(solved), strips_({0, solved.rows}, std::max(1, solved.rows / kStripRows)) {
    cv::cvtColor(bracket.light, light_, cv::COLOR_BGR2BGRA);
    slopes_.create(solved.size());
    const LightCurve& curve = *bracket.curve;
    forEachPixel(solved.size(), [&](int y, int x) {
      for (int c = 0; c < 3; ++c) slopes_(y, x)[c] = 1 / curve.slope(bracket.fused(y, x)[c]);
    });
  }

  // To be called first. False when proceed said stop.
  bool build(const std::vector<ImageFormation>& formation, const std::function<bool(double)>& proceed) {
    const int threads = std::max(1, cv::getNumThreads());
    equations_.resize(strips_.count());
    for (cv::Range group; group.end < strips_.count();) {
      if (!proceed(static_cast<double>(group.end) / strips_.count())) return false;
      group = {group.end, std::min(group.end + 4 * threads, strips_.count())};
      cv::parallel_for_(
          group,
          [&](const cv::Range& strips) {
            Strip built;  // grows once for all: new memory is slow
            for (int i = strips.start; i < strips.end; ++i) {
              buildStrip(formation, strips_[i], built);
              equations_[i] = built;
            }
          },
          threads);
    }
    return true;
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
    cv::Vec4f sum;
    for (std::uint32_t i = 0; i < row.count; ++i)
      sum += static_cast<float>(parts[i].share) * here[parts[i].dy * stride + parts[i].dx];
    return cv::Vec3f(sum.val).mul(row.slope) * (1 / kWholeShare);
  }

  // out = A^T omega values(row, parts), by pixel.
  template <typename Values>
  void transposed(const Values& values, cv::Mat3f& out) {
    spread(
        [&](const Row& row, const Part* parts) { return (row.weight * values(row, parts)).mul(row.slope); },
        [](float factor) { return factor; }, out);
  }

  // Diagonal of A^T omega A.
  cv::Mat3f diagonal() {
    cv::Mat3f out;
    spread([&](const Row& row, const Part*) { return row.weight * row.slope.mul(row.slope); },
           [](float factor) { return factor * factor; }, out);
    return out;
  }

  // z in linear light, valid until the next call; the last channel is 0.
  const cv::Mat4f& toLight(const cv::Mat3f& z) {
    z_light_.create(z.size());
    forEachPixel(z.size(), [&](int y, int x) {
      const cv::Vec3f light = z(y, x).mul(slopes_(y, x));
      z_light_(y, x) = {light[0], light[1], light[2], 0};
    });
    return z_light_;
  }
  const cv::Mat1b& solved() const { return solved_; }

 private:
  void buildStrip(const std::vector<ImageFormation>& formation, const cv::Range& rows, Strip& strip) const {
    strip.rows.clear();
    strip.parts.clear();
    std::vector<std::pair<float, size_t>> nearly_sharp;  // radius and frame
    std::vector<ImageFormation::Part> parts;
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < solved_.cols; ++x) {
        if (!solved_(y, x)) continue;
        nearly_sharp.clear();
        for (size_t k = 0; k < formation.size(); ++k) {
          const float radius = formation[k].radius({x, y});
          if (radius < kInversion.sharp && bracket_.frames[k].shown(y, x))
            nearly_sharp.emplace_back(radius, k);
        }
        std::sort(nearly_sharp.begin(), nearly_sharp.end());
        if (nearly_sharp.size() > solved_(y, x)) nearly_sharp.resize(solved_(y, x));
        for (const auto& [radius, k] : nearly_sharp) {
          formation[k].partsOf({x, y}, formation[k].inverseDepth({x, y}), parts);
          addRow({x, y}, bracket_.frames[k], radius, parts, strip);
        }
      }
    }
  }

  // radius: of p's blur in that frame.
  void addRow(const cv::Point& p, const ObservedFrame& frame, float radius,
              const std::vector<ImageFormation::Part>& parts, Strip& strip) const {
    const LightCurve& curve = *bracket_.curve;
    const std::ptrdiff_t stride = solved_.cols;
    const cv::Vec4f* light_here = &light_(p);
    const std::uint8_t* solved_here = &solved_(p);
    cv::Vec4f light;
    for (const ImageFormation::Part& part : parts)
      light += part.share * light_here[part.dy * stride + part.dx];

    Row row;
    row.x = p.x;
    row.y = p.y;
    const float trust = frame.is_exact ? 1 : kInversion.inexact_share;
    row.weight = static_cast<float>(trust / (bracket_.noise_variance + kInversion.model_variance +
                                             kInversion.model_error * radius * radius));
    for (int c = 0; c < 3; ++c) {
      const float code = curve.code(light[c]);
      row.residual[c] = static_cast<float>(frame.codes(p)[c]) / kCodeScale - code;
      row.slope[c] = curve.slope(code);
    }
    row.first = static_cast<std::uint32_t>(strip.parts.size());
    strip.parts.resize(row.first + parts.size());
    Part* to = strip.parts.data() + row.first;
    for (const ImageFormation::Part& part : parts) {
      if (std::max(std::abs(part.dx), std::abs(part.dy)) <= kFarthestPart &&
          solved_here[part.dy * stride + part.dx])
        *to++ = {static_cast<std::int8_t>(part.dx), static_cast<std::int8_t>(part.dy),
                 static_cast<std::uint16_t>(part.share * kWholeShare + 0.5f)};
    }
    strip.parts.resize(to - strip.parts.data());
    row.count = static_cast<std::uint32_t>(strip.parts.size()) - row.first;
    strip.rows.push_back(row);
  }

  // out = sum over rows of factor(share) factor(slope) value(row): each strip into rows of its own, which are
  // then added in their order, so that the sum does not depend on the number of threads.
  template <typename Value, typename Factor>
  void spread(const Value& value, const Factor& factor, cv::Mat3f& out) {
    sums_.resize(strips_.count());
    const std::ptrdiff_t stride = solved_.cols;
    strips_.forEach([&](const cv::Range& rows, int i) {
      sums_[i].create(rows.size() + 2 * kFarthestPart, solved_.cols);
      sums_[i].setTo(cv::Scalar());
      for (const Row& row : equations_[i].rows) {
        const Part* parts = equations_[i].parts.data() + row.first;
        const cv::Vec3f wanted = value(row, parts);
        const cv::Vec4f here(wanted[0], wanted[1], wanted[2], 0);
        cv::Vec4f* to = &sums_[i](row.y - rows.start + kFarthestPart, row.x);
        for (std::uint32_t k = 0; k < row.count; ++k) {
          to[parts[k].dy * stride + parts[k].dx] +=
              factor(static_cast<float>(parts[k].share) * (1 / kWholeShare)) * here;
        }
      }
    });
    out.create(solved_.size());
    strips_.forEach([&](const cv::Range& rows, int i) {
      for (int y = rows.start; y < rows.end; ++y) {
        std::array<const cv::Vec4f*, 3> from;  // of this strip and its neighbours
        int count = 0;
        for (int k = std::max(0, i - 1); k < std::min(i + 2, strips_.count()); ++k) {
          const int row = y - strips_[k].start + kFarthestPart;
          if (row >= 0 && row < sums_[k].rows) from[count++] = sums_[k][row];
        }
        for (int x = 0; x < out.cols; ++x) {
          cv::Vec4f sum;
          for (int k = 0; k < count; ++k) sum += from[k][x];
          for (int c = 0; c < 3; ++c) out(y, x)[c] = factor(slopes_(y, x)[c]) * sum[c];
        }
      }
    });
  }

  const ObservedBracket& bracket_;
  cv::Mat4f light_;  // of the fused picture
  cv::Mat1b solved_;
  RowStrips strips_;
  std::vector<Strip> equations_;
  cv::Mat3f slopes_;  // d light / d code of the fused picture
  std::vector<cv::Mat4f> sums_;
  cv::Mat4f z_light_;
};

cv::Vec3f squared(const cv::Vec3f& v) {
  return v.mul(v);
}

float mean(const cv::Vec3f& v) {
  return (v[0] + v[1] + v[2]) / 3;
}

// Squared residuals of the frames by pixel, mean over channels, in excess of noise; weighted by omega,
// smoothed. z: in light; empty = none.
cv::Mat1f excessOf(const Equations& equations, const cv::Mat4f& z, double noise_variance) {
  cv::Mat1f excess(equations.solved().size(), 0);
  equations.forEach([&](const Row& row, const Part* parts) {
    const cv::Vec3f left = z.empty() ? row.residual : row.residual - Equations::predicted(row, parts, z);
    excess(row.y, row.x) += row.weight * (mean(squared(left)) - static_cast<float>(noise_variance));
  });
  cv::GaussianBlur(excess, excess, {}, kInversion.residual_sigma);
  return excess;
}

// The sum of omega by pixel, smoothed alike.
cv::Mat1f weightOf(const Equations& equations) {
  cv::Mat1f weight(equations.solved().size(), 0);
  equations.forEach([&](const Row& row, const Part*) { weight(row.y, row.x) += row.weight; });
  cv::GaussianBlur(weight, weight, {}, kInversion.residual_sigma);
  return weight;
}

// 1 / s^2.
cv::Mat1f priorOf(const cv::Mat1f& excess, const cv::Mat1f& weight, double noise_variance) {
  const auto least =
      static_cast<float>(kInversion.prior_share * (noise_variance + kInversion.least_variance));
  return cv::Mat1f(1 / (least + cv::max(excess / cv::max(weight, 1e-6f), 0)));
}

// (A^T omega A + 1 / s^2 + smoothness) z
void apply(Equations& equations, const cv::Mat1f& prior, const cv::Mat3f& z, cv::Mat3f& out) {
  const cv::Mat4f& light = equations.toLight(z);
  equations.transposed(
      [&](const Row& row, const Part* parts) { return Equations::predicted(row, parts, light); }, out);
  const cv::Mat1b& solved = equations.solved();
  forEachPixel(z.size(), [&](int y, int x) {
    if (!solved(y, x)) return;
    const cv::Vec3f& here = z(y, x);
    cv::Vec3f bend;
    for (const cv::Point& step : {cv::Point(-1, 0), cv::Point(1, 0), cv::Point(0, -1), cv::Point(0, 1)}) {
      const cv::Point q = cv::Point(x, y) + step;
      if (q.x >= 0 && q.y >= 0 && q.x < z.cols && q.y < z.rows) bend += here - z(q);
    }
    out(y, x) += prior(y, x) * here + kInversion.smoothness * bend;
  });
}

// Channels on their own.
cv::Scalar ratio(const cv::Scalar& a, const cv::Scalar& b) {
  cv::Scalar r;
  for (int c = 0; c < 3; ++c) r[c] = b[c] > 0 ? a[c] / b[c] : 0;
  return r;
}

cv::Mat scaled(const cv::Mat3f& image, const cv::Scalar& factors) {
  cv::Mat result;
  cv::multiply(image, factors, result);
  return result;
}

// Conjugate gradients, preconditioned by the diagonal; channels on their own.
std::optional<cv::Mat3f> solve(Equations& equations, const cv::Mat1f& prior,
                               const std::function<bool(double)>& proceed) {
  cv::Mat3f residual, z(prior.size(), cv::Vec3f::all(0)), product;
  equations.transposed([](const Row& row, const Part*) { return row.residual; }, residual);
  residual.setTo(cv::Scalar(), equations.solved() == 0);
  cv::Mat3f inverse = equations.diagonal();
  forEachPixel(z.size(), [&](int y, int x) {
    for (int c = 0; c < 3; ++c)
      inverse(y, x)[c] = 1 / (inverse(y, x)[c] + prior(y, x) + 4 * kInversion.smoothness);
  });
  cv::Mat3f direction(residual.mul(inverse));
  cv::Scalar energy = cv::sum(direction.mul(residual));
  for (int i = 1;; ++i) {
    if (!proceed(static_cast<double>(i - 1) / kInversion.steps)) return std::nullopt;
    apply(equations, prior, direction, product);
    const cv::Scalar length = ratio(energy, cv::sum(direction.mul(product)));
    z += scaled(direction, length);
    if (i == kInversion.steps) return z;
    residual -= scaled(product, length);
    const cv::Mat3f steepest(residual.mul(inverse));
    const cv::Scalar next = cv::sum(steepest.mul(residual));
    direction = steepest + scaled(direction, ratio(next, energy));
    energy = next;
  }
}

// How much of z is kept, 0..1: by the share of the residual in excess of noise that z explains.
cv::Mat1f gate(const cv::Mat1f& before, const cv::Mat1f& after, const cv::Mat1f& weight,
               double noise_variance) {
  const double chance = kInversion.chance * noise_variance + 1e-3;
  const cv::Mat1f share((before - after) / cv::max(before, chance * weight + 1e-9));
  return cv::Mat1f(
      cv::max(cv::min((share - kInversion.gate_from) / (kInversion.gate_to - kInversion.gate_from), 1), 0));
}

// region, 0..1: where to correct. Beside jumps, and where no frame is sharp. solved: see Equations.
void findRegion(const ObservedBracket& bracket, const cv::Mat1f& inverse_depth, cv::Mat1f& region,
                cv::Mat1b& solved) {
  besideJumps(inverse_depth, bracket.gap(kInversion.band_jump), kInversion.band)
      .convertTo(region, CV_32F, 1 / 255.0);
  solved = region > 0;
  forEachPixel(region.size(), [&](int y, int x) {
    float least = kInversion.soft_to;
    for (const ObservedFrame& frame : bracket.frames) {
      if (frame.shown(y, x)) least = std::min(least, frame.blur.radius(inverse_depth(y, x)));
    }
    const float soft = (least - kInversion.soft_from) / (kInversion.soft_to - kInversion.soft_from);
    region(y, x) = std::max(region(y, x), soft);
    if (soft > 0 && !solved(y, x)) solved(y, x) = kInversion.soft_frames;
  });
}

}  // namespace

std::optional<cv::Mat3f> correction(const ObservedBracket& bracket,
                                    const std::vector<ImageFormation>& formation,
                                    const cv::Mat1f& inverse_depth,
                                    const std::function<bool(double)>& proceed) {
  cv::Mat1f region;
  cv::Mat1b solved;
  findRegion(bracket, inverse_depth, region, solved);
  if (cv::countNonZero(solved) == 0) return cv::Mat3f(cv::Mat3f::zeros(solved.size()));
  Equations equations(bracket, solved);
  if (!equations.build(formation, [&](double done) { return proceed(0.4 * done); })) return std::nullopt;
  if (!proceed(0.4)) return std::nullopt;
  const cv::Mat1f excess = excessOf(equations, {}, bracket.noise_variance), weight = weightOf(equations);
  std::optional<cv::Mat3f> z = solve(equations, priorOf(excess, weight, bracket.noise_variance),
                                     [&](double done) { return proceed(0.4 + 0.5 * done); });
  if (!z) return z;
  const cv::Mat4f& light = equations.toLight(*z);
  const cv::Mat1f left = excessOf(equations, light, bracket.noise_variance);
  const cv::Mat1f by_frames = gate(excess, left, weight, bracket.noise_variance);
  const cv::Mat1f kept(region.mul(by_frames));
  forEachPixel(kept.size(), [&](int y, int x) { (*z)(y, x) *= kept(y, x); });
  return z;
}

}  // namespace all_in_focus::core
