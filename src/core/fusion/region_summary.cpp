// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/region_summary.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>

namespace all_in_focus::core {
namespace {

constexpr double kSharp = 2;           // blur circles, in circles of confusion, that still pass for sharp
constexpr double kLeastShare = 0.001;  // of the picture: smaller regions are not worth a line
constexpr std::size_t kMaxLines = 5;

}  // namespace

std::vector<RegionChoice> summarizeRegions(const cv::Mat& labels, const cv::Mat& source_index,
                                           const cv::Mat& confidence) {
  // One entry per run of pixels of the same region and frame, then sorted: regions and frames may be many.
  struct Won {
    std::uint64_t key;  // label, frame
    std::int64_t pixels, confidence;
  };
  std::vector<Won> runs;
  for (int y = 0; y < labels.rows; ++y) {
    const auto* label = labels.ptr<std::int32_t>(y);
    const auto* source = source_index.ptr<std::uint16_t>(y);
    const auto* sure = confidence.ptr<std::uint8_t>(y);
    for (int x = 0; x < labels.cols; ++x) {
      const std::uint64_t key = static_cast<std::uint64_t>(label[x]) << 16 | source[x];
      if (x == 0 || runs.back().key != key) runs.push_back({key, 0, 0});
      ++runs.back().pixels;
      runs.back().confidence += sure[x];
    }
  }
  std::sort(runs.begin(), runs.end(), [](const Won& a, const Won& b) { return a.key < b.key; });

  std::vector<RegionChoice> regions;
  for (std::size_t i = 0; i < runs.size();) {
    const int label = static_cast<int>(runs[i].key >> 16);
    std::int64_t area = 0, confidence_sum = 0, best = 0, second = 0;
    int frame = kNoFrame;
    while (i < runs.size() && static_cast<int>(runs[i].key >> 16) == label) {
      const std::uint64_t key = runs[i].key;
      std::int64_t pixels = 0;
      for (; i < runs.size() && runs[i].key == key; ++i) {
        pixels += runs[i].pixels;
        confidence_sum += runs[i].confidence;
      }
      area += pixels;
      if (pixels > best) {
        second = best;
        best = pixels;
        frame = static_cast<int>(key & 0xffff);
      } else {
        second = std::max(second, pixels);
      }
    }
    const auto whole = static_cast<double>(area), most = static_cast<double>(best);
    const double score = most / whole, margin = 1 - static_cast<double>(second) / most;
    regions.push_back({label, frame, score, margin, static_cast<double>(confidence_sum) / (255 * whole)});
  }
  return regions;
}

std::vector<std::string> unreachedDistances(const BracketScene& scene, const std::vector<double>& focus_mm) {
  std::vector<std::string> lines;
  if (scene.depth.empty() || scene.labels.size() != scene.depth.size()) return lines;
  const auto unknown = [](double focus) { return std::isnan(focus); };
  if (focus_mm.empty() || std::any_of(focus_mm.begin(), focus_mm.end(), unknown)) return lines;

  struct Region {
    std::int64_t area = 0;
    double inverse_depth = 0;  // sum of 1 / depth
  };
  std::map<int, Region> regions;
  Region* region = nullptr;
  for (int y = 0, last = -1; y < scene.depth.rows; ++y) {
    const auto* label = scene.labels.ptr<std::int32_t>(y);
    const auto* depth = scene.depth.ptr<std::uint16_t>(y);
    for (int x = 0; x < scene.depth.cols; ++x) {
      if (depth[x] == 0) continue;
      if (!region || label[x] != last) region = &regions[last = label[x]];
      ++region->area;
      region->inverse_depth += 1.0 / depth[x];
    }
  }
  for (const auto& [label, sum] : regions) {
    const auto area = static_cast<double>(sum.area);
    if (area < kLeastShare * static_cast<double>(scene.depth.total())) continue;
    const double depth = area / sum.inverse_depth;
    double least = std::numeric_limits<double>::infinity(), nearest = 0;
    for (const double focus : focus_mm) {
      const double blur = blurCircle(scene.optics, depth, focus);
      if (blur < least) {
        least = blur;
        nearest = focus;
      }
    }
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
