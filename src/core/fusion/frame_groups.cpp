// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/frame_groups.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "util/median.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct GroupParameters {
  int most_columns = 20, most_rows = 15;  // of blocks
  int samples = 16;                       // per side of a block; in smaller ones blur would change the light
  double dark_code = 3;                   // below, noise hides the light
  double small_change = 0.22;             // of the logarithm of light: a quarter more or less
  double small_part = 0.06;               // of the picture; from frame to frame 0.02 at most, by focus
  double usual_steps = 3;                 // a longer step is a jump
  std::size_t compared = 4;  // frames on each side: those of three that something hides, and one more
} kGroups{};

double medianOf(const cv::Mat& values) {
  return median(std::vector<float>(values.begin<float>(), values.end<float>()));
}

// The usual step to a frame from the nearer one of the two before it: an odd frame makes one long step, not
// two. Infinite ones do not count.
double usualStep(const std::vector<int>& frames, const std::function<double(int, int)>& distance) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    double step = distance(frames[i], frames[i - 1]) / (frames[i] - frames[i - 1]);
    if (i > 1) step = std::min(step, distance(frames[i], frames[i - 2]) / (frames[i] - frames[i - 2]));
    if (std::isfinite(step)) steps.push_back(step);
  }
  return median(steps);
}

}  // namespace

void FrameLight::observe(const cv::Mat& gray, int index) {
  const cv::Size grid(std::clamp(gray.cols / kGroups.samples, 1, kGroups.most_columns),
                      std::clamp(gray.rows / kGroups.samples, 1, kGroups.most_rows));
  cv::Mat codes, logarithms;
  cv::resize(gray, codes, grid * kGroups.samples, 0, 0, cv::INTER_NEAREST);
  cv::resize(codes, codes, grid, 0, 0, cv::INTER_AREA);
  cv::log(linearLight(codes, LightCurve::srgb()) + lightOf(kGroups.dark_code), logarithms);
  blocks_[index] = logarithms;
}

double FrameLight::ratio(int index, int reference) const {
  return std::exp(medianOf(blocks_.at(index) - blocks_.at(reference)));
}

double FrameLight::changed(int index, int other) const {
  const cv::Mat difference = blocks_.at(index) - blocks_.at(other);
  const cv::Mat differs = cv::abs(difference - medianOf(difference)) > kGroups.small_change;
  return cv::countNonZero(differs) / static_cast<double>(differs.total());
}

FrameLight::Neighbours FrameLight::neighbours(int index, const std::function<bool(int)>& counts) const {
  const auto nearest = [&](auto it, const auto& end) {
    std::vector<int> found;
    for (; it != end && found.size() < kGroups.compared; ++it) {
      if (std::abs(std::log(ratio(it->first, index))) <= kGroups.small_change && counts(it->first))
        found.push_back(it->first);
    }
    return found;
  };
  const auto here = blocks_.find(index);
  Neighbours near{nearest(std::make_reverse_iterator(here), blocks_.rend()),
                  nearest(std::next(here), blocks_.end())};
  std::vector<int> order(near.before.rbegin(), near.before.rend());
  order.push_back(index);
  order.insert(order.end(), near.behind.begin(), near.behind.end());
  near.usual = usualStep(order, [this](int later, int earlier) { return changed(later, earlier); });
  for (const int other : order) near.differing += differs(index, other, near.usual) ? 1 : 0;
  near.alike = static_cast<int>(order.size()) - near.differing;
  return near;
}

bool FrameLight::differs(int index, int other, double usual) const {
  return changed(index, other) >
         std::max(kGroups.small_part, kGroups.usual_steps * usual * std::abs(index - other));
}

double FrameLight::intrusion(int index, const std::function<bool(int)>& counts) const {
  if (blocks_.rbegin()->first == index) return 0;  // of the newest frame nobody knows yet what stays
  const Neighbours near = neighbours(index, counts);
  if (near.differing <= near.alike) return 0;
  double part = 0;
  for (const int before : near.before) {
    for (const int behind : near.behind) {
      if (!differs(index, before, near.usual) || !differs(index, behind, near.usual)) continue;
      const double least = std::min(changed(index, before), changed(index, behind));
      if (changed(behind, before) < least / 2) part = std::max(part, least);
    }
  }
  return part;
}

bool FrameLight::isSudden(int index, const std::function<bool(int)>& counts) const {
  const Neighbours near = neighbours(index, counts);
  return near.behind.empty() && near.differing > 0 && near.differing >= near.alike;
}

double FrameLight::jump(int index, int reference, double most) const {
  const auto are_near = [most](double ratio) { return ratio <= most && ratio >= 1 / most; };
  const double direct = ratio(index, reference);
  if (are_near(direct)) return 1;
  std::vector<int> between;
  for (const auto& [other, blocks] : blocks_) {
    if (other > std::min(index, reference) && other < std::max(index, reference)) between.push_back(other);
  }
  if (index < reference) std::reverse(between.begin(), between.end());
  int last = reference;  // odd frames are passed over
  for (const int other : between) {
    if (are_near(ratio(other, last))) last = other;
  }
  return are_near(ratio(index, last)) ? 1 : direct;
}

FrameGroup largestGroup(const FrameLight& light, const std::function<double(int, int)>& displacement,
                        double radius) {
  const auto change = [&light](int index, int earlier) {
    return std::abs(std::log(light.ratio(index, earlier)));
  };
  const auto part = [&light](int index, int earlier) { return light.changed(index, earlier); };
  std::vector<int> frames;
  for (const auto& [index, blocks] : light.frames()) frames.push_back(index);
  const auto usual = [&](const std::function<double(int, int)>& distance) {
    return usualStep(frames, [&](int index, int earlier) {
      return displacement(index, earlier) >= 0 ? distance(index, earlier)
                                               : std::numeric_limits<double>::infinity();
    });
  };
  const double usual_shift = usual(displacement), usual_change = usual(change), usual_part = usual(part);

  std::vector<std::set<int>> runs;  // of frames that follow each other without a jump
  for (const int index : frames) {
    const auto follows = [&](const std::set<int>& run) {
      const int last = *run.rbegin();
      const double steps = kGroups.usual_steps * (index - last), shift = displacement(index, last);
      return shift >= 0 && shift <= std::max(kSmallShift * radius, steps * usual_shift) &&
             change(index, last) <= std::max(kGroups.small_change, steps * usual_change) &&
             part(index, last) <= std::max(kGroups.small_part, steps * usual_part);
    };
    auto run = std::find_if(runs.begin(), runs.end(), follows);
    if (run == runs.end()) run = runs.emplace(run);
    run->insert(index);
  }

  std::stable_sort(runs.begin(), runs.end(),
                   [](const auto& a, const auto& b) { return a.size() > b.size(); });
  FrameGroup group;
  for (std::size_t i = 1; i < runs.size(); ++i) group.others.insert(runs[i].begin(), runs[i].end());
  if (!runs.empty()) group.lead = static_cast<int>(runs[0].size() - (runs.size() > 1 ? runs[1].size() : 0));
  return group;
}

}  // namespace all_in_focus::core
