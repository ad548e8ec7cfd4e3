// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/region_summary.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

namespace all_in_focus::core {
namespace {

constexpr double kSharp = 2;           // blur circles, in circles of confusion, that still pass for sharp
constexpr double kLeastShare = 0.001;  // of the picture: smaller regions are not worth a line
constexpr std::size_t kMaxLines = 5;

}  // namespace

std::vector<RegionChoice> summarizeRegions(const cv::Mat& labels, const cv::Mat& source_index,
                                           const cv::Mat& confidence) {
  struct Won {
    double pixels = 0, confidence = 0;
  };
  std::map<std::pair<int, int>, Won> won;  // by label, frame
  for (int y = 0; y < labels.rows; ++y) {
    const auto* label = labels.ptr<std::int32_t>(y);
    const auto* source = source_index.ptr<std::uint16_t>(y);
    const auto* sure = confidence.ptr<std::uint8_t>(y);
    Won* here = nullptr;
    for (int x = 0; x < labels.cols; ++x) {
      const bool goes_on = x > 0 && label[x] == label[x - 1] && source[x] == source[x - 1];
      if (!goes_on) here = &won[{label[x], source[x]}];
      ++here->pixels;
      here->confidence += sure[x];
    }
  }
  std::vector<RegionChoice> regions;
  for (auto it = won.begin(); it != won.end();) {
    RegionChoice region{it->first.first};
    double area = 0, confidence_sum = 0, best = 0, second = 0;
    for (; it != won.end() && it->first.first == region.label; ++it) {
      const auto& [pixels, sum] = it->second;
      area += pixels;
      confidence_sum += sum;
      second = std::max(second, std::min(best, pixels));
      if (pixels > best) region.frame = it->first.second;
      best = std::max(best, pixels);
    }
    region.score = best / area;
    region.margin = 1 - second / best;
    region.confidence = confidence_sum / (255 * area);
    regions.push_back(region);
  }
  return regions;
}

std::vector<std::string> unreachedDistances(const BracketScene& scene, const std::vector<double>& focus_mm) {
  std::vector<std::string> lines;
  if (scene.depth.empty() || scene.labels.size() != scene.depth.size()) return lines;
  const auto unknown = [](double focus) { return std::isnan(focus); };
  if (focus_mm.empty() || std::any_of(focus_mm.begin(), focus_mm.end(), unknown)) return lines;

  struct Region {
    double area = 0, inverse_depth = 0;  // sum of 1 / depth
  };
  std::map<int, Region> regions;
  for (int y = 0; y < scene.depth.rows; ++y) {
    const auto* label = scene.labels.ptr<std::int32_t>(y);
    const auto* depth = scene.depth.ptr<std::uint16_t>(y);
    Region* region = nullptr;
    for (int x = 0; x < scene.depth.cols; ++x) {
      if (x == 0 || label[x] != label[x - 1]) region = &regions[label[x]];
      if (depth[x] == 0) continue;
      ++region->area;
      region->inverse_depth += 1.0 / depth[x];
    }
  }
  for (const auto& [label, region] : regions) {
    if (region.area == 0 || region.area < kLeastShare * static_cast<double>(scene.depth.total())) continue;
    const double depth = region.area / region.inverse_depth;
    const auto blurOf = [&](double focus) { return blurCircle(scene.optics, depth, focus); };
    const double nearest = *std::min_element(focus_mm.begin(), focus_mm.end(),
                                             [&](double a, double b) { return blurOf(a) < blurOf(b); });
    const double least = blurOf(nearest);
    if (least <= kSharp * scene.optics.circle_of_confusion_mm) continue;
    if (lines.size() == kMaxLines) {
      lines.push_back("further regions are not reached either");
      break;
    }
    lines.push_back(cv::format(
        "the bracket does not reach %.2f m (region %d): focused at %s at best, its blur "
        "circle there is %.1f circles of confusion wide",
        depth / 1000, label, std::isinf(nearest) ? "infinity" : cv::format("%.2f m", nearest / 1000).c_str(),
        least / scene.optics.circle_of_confusion_mm));
  }
  return lines;
}

}  // namespace all_in_focus::core
