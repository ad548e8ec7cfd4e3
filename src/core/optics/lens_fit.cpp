// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "optics/lens_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace all_in_focus::core {
namespace {

constexpr double kAsGood = 0.03;  // shares that differ by less tell nothing of a scale
// The same of two frames without depth: other depths make up for most of a scale that is too large.
constexpr double kAsGoodOfTwo = 0.005;
constexpr double kClearly = 0.06;   // the same of focus distances: depth has errors of its own
constexpr double kNeighbour = 1.2;  // factor between a scale and those beside it
constexpr double kUnusual = 1.1;    // a factor that people are told of
// Factors from 1/10 to 10 are tried in steps; then finer ones beside the best, down to 1/kPerDecade of a
// decade. Only few focus distances look right.
constexpr int kPerDecade = 128, kStepOfScales = 16, kStepOfDistances = 4;

// Units that distances may be in: instead of mm, in files, or instead of m, in messages.
struct Unit {
  double factor;
  const char* name;
};
constexpr std::array<Unit, 8> kUnits = {{{1000, "m"},
                                         {10, "cm"},
                                         {25.4, "inches"},
                                         {304.8, "feet"},
                                         {1e-3, "mm"},
                                         {1e-2, "cm"},
                                         {25.4e-3, "inches"},
                                         {304.8e-3, "feet"}}};
constexpr double kSameUnit = 1.05;

struct Factor {
  double value = 1, explained = 0;
};

template <class Function>
Factor bestFactor(int step, const Function& explained) {
  Factor best = {1, explained(1)};
  int middle = 0;
  for (int reach = kPerDecade; step > 0; reach = step - 1, step /= 4) {
    const int from = middle - reach / step * step, to = middle + reach;
    for (int i = from; i <= to; i += step) {
      const double value = std::pow(10, static_cast<double>(i) / kPerDecade), share = explained(value);
      if (share <= best.explained) continue;
      best = {value, share};
      middle = i;
    }
  }
  return best;
}

Factor bestScale(const BlurEvidence& evidence, const std::vector<FrameBlur>& blur) {
  const auto explained = [&](double scale) { return evidence.explained(blur, scale); };
  const Factor best = bestFactor(kStepOfScales, explained);
  if (!evidence.hasDepth()) return best;
  const double typical = evidence.typicalScale(blur, best.value);
  const Factor other = {typical, explained(typical)};
  return other.explained > best.explained - kAsGood ? other : best;
}

// Mistakes in the order of focus distances.
constexpr std::array<FocusCorrection, 3> kOfOrder = {{{true, 0, 1}, {false, 1, 1}, {false, -1, 1}}};

bool explainsLess(const LensFit& a, const LensFit& b) {
  return a.explained < b.explained;
}

// evidence has depth.
LensFit twoMistakes(const BlurEvidence& evidence, const std::vector<FrameBlur>& given) {
  LensFit best = {{}, 1, -std::numeric_limits<double>::infinity()};
  const auto tryBoth = [&](const FocusCorrection& focus) {
    const Factor scale = bestScale(evidence, focus.of(given));
    best = std::max(best, {focus, scale.value, scale.explained}, explainsLess);
    return scale.explained;
  };
  for (const FocusCorrection& focus : kOfOrder) tryBoth(focus);
  bestFactor(kStepOfDistances, [&](double factor) { return tryBoth({false, 0, factor}); });
  best.is_certain = false;
  return best;
}

}  // namespace

std::vector<FrameBlur> FocusCorrection::of(const std::vector<FrameBlur>& given) const {
  std::vector<FrameBlur> blur = given;
  const int n = static_cast<int>(given.size());
  for (int k = 0; k < n; ++k) {
    const auto focus = [&](int i) { return given[static_cast<std::size_t>(i)].inverse_depth; };
    const int from = (reversed ? n - 1 - k : k) + shift;
    // Beyond its ends the list goes on in even steps.
    const double to = from < 0    ? focus(0) + from * (focus(1) - focus(0))
                      : from >= n ? focus(n - 1) + (from - n + 1) * (focus(n - 1) - focus(n - 2))
                                  : focus(from);
    blur[static_cast<std::size_t>(k)] = blur[static_cast<std::size_t>(k)].focusedAt(to / factor);
  }
  return blur;
}

std::vector<std::string> LensFit::notes(const Optics& optics) const {
  std::vector<std::string> notes;
  if (focus.reversed) notes.emplace_back("the frames show that the focus distances are in reverse order");
  if (focus.shift != 0)
    notes.emplace_back("the frames show that the focus distances are shifted by one frame");
  if (focus.factor != 1) {
    const auto unit = std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& one) {
      return std::max(focus.factor / one.factor, one.factor / focus.factor) < kSameUnit;
    });
    const std::string hint =
        unit == kUnits.end() ? "" : cv::format(" (%g: are they in %s?)", unit->factor, unit->name);
    notes.push_back(
        cv::format("the frames show that the focus distances are to be multiplied by %.3g", focus.factor) +
        hint);
  }
  if (!uses_depth)
    notes.emplace_back("the frames contradict the depth at these focus distances: it is not used");
  const double times = std::max(scale, 1 / scale);
  if (times > kUnusual) {
    notes.push_back(cv::format(
        "the frames are blurred %.2g times %s than %g mm at F %g predicts: was it F %.2g?", times,
        scale < 1 ? "less" : "more", optics.focal_length_mm, optics.aperture, optics.aperture / scale));
  }
  return notes;
}

LensFit fitLens(const BlurEvidence& evidence, const std::vector<FrameBlur>& given,
                const std::optional<FocusCorrection>& voted, bool has_scale) {
  if (!evidence.showsBlur()) return {{}, 1, 1, false};
  const auto with = [&](const FocusCorrection& focus, double scale) {
    return LensFit{focus, scale, evidence.explained(focus.of(given), scale)};
  };
  const bool is_of_two = given.size() == 2 && !evidence.hasDepth();
  const bool may_correct = evidence.hasDepth() && has_scale && !voted;
  const FocusCorrection focus = voted.value_or(FocusCorrection());
  LensFit best = with(focus, 1);
  LensFit ordered = best;  // the best in another order
  for (const FocusCorrection& other : kOfOrder) {
    if (may_correct) ordered = std::max(ordered, with(other, 1), explainsLess);
  }
  // A mistake shows beside what was given, too, unless the frames are two: so most lenses need no search.
  if (has_scale && !is_of_two && best.explained >= LensFit::kBelieved &&
      best.explained + kClearly >= ordered.explained &&
      best.explained + kAsGood >=
          std::max(with(focus, kNeighbour), with(focus, 1 / kNeighbour), explainsLess).explained)
    return best;

  // The more common mistakes first: a later one must explain more.
  const Factor scale = bestScale(evidence, focus.of(given));
  const LensFit scaled = {focus, scale.value, scale.explained};
  if (!has_scale) return scaled;  // a guess has no scale of its own
  const double as_given = best.explained;
  const auto take = [&best](const LensFit& fit, double clearly) {
    if (fit.explained > best.explained + clearly) best = fit;
  };
  take(ordered, kClearly);
  take(scaled, is_of_two ? kAsGoodOfTwo : kAsGood);
  if (!may_correct) return best;
  const auto explainedBy = [&](double value) { return with({false, 0, value}, 1).explained; };
  Factor factor = bestFactor(kStepOfDistances, explainedBy);
  for (const Unit& unit : kUnits) {
    if (const double share = explainedBy(unit.factor); share > factor.explained + kAsGood)
      factor = {unit.factor, share};
  }
  const LensFit enlarged = {{false, 0, factor.value}, 1, factor.explained};
  if (enlarged.explained > as_given + kClearly) take(enlarged, kAsGood);
  const std::array<LensFit, 3> all = {ordered, scaled, enlarged};
  best.is_certain = 1 == std::count_if(all.begin(), all.end(), [&](const LensFit& fit) {
                      return fit.explained > best.explained - kAsGood;
                    });
  return best;
}

LensFit fitWrongLens(const BlurEvidence& evidence, const std::vector<FrameBlur>& given, bool has_scale) {
  LensFit fit = fitLens(evidence, given, std::nullopt, has_scale);
  if (!evidence.hasDepth() || !fit.contradicts()) return fit;
  if (has_scale) {
    const LensFit two = twoMistakes(evidence, given);
    if (two.explained > fit.explained + kClearly) fit = two;  // two mistakes are less likely than one
    if (!fit.contradicts()) return fit;
  }
  LensFit free = fitLens(evidence.withoutDepth(), given, std::nullopt, has_scale);
  free.uses_depth = false;
  return free;
}

}  // namespace all_in_focus::core
