// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/region_captions.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace all_in_focus::core {
namespace {

constexpr double kLetterHeight = 22;  // pixels, of OpenCV's font at scale 1
constexpr double kTextHeight = 0.04;  // share of the picture's height
constexpr double kMinScale = 0.35;    // smaller letters are not legible
constexpr float kMinDistance = 0.8f;  // share of the greatest distance from the region's border
constexpr int kMinOnRegion = 242;     // of 255: how much of a text's box must lie on its region, 95 %

std::string captionText(const Segment& segment) {
  return cv::format("%d: %.2f-%.2f m", segment.label, segment.min_mm / 1e3, segment.max_mm / 1e3);
}

// Distance of each pixel from the border of its region, for all regions in one pass. The edge of the picture
// counts as a border, so that captions stay away from it.
cv::Mat borderDistance(const cv::Mat& labels) {
  cv::Mat inside(labels.size(), CV_8UC1, cv::Scalar(0)), distance;
  for (int y = 1; y + 1 < labels.rows; ++y) {
    const auto* label = labels.ptr<std::int32_t>(y);
    const auto* below = labels.ptr<std::int32_t>(y + 1);
    auto* to = inside.ptr<std::uint8_t>(y);
    for (int x = 1; x + 1 < labels.cols; ++x)
      to[x] = label[x] == label[x + 1] && label[x] == below[x] ? 255 : 0;
  }
  cv::distanceTransform(inside, distance, cv::DIST_L2, 3);
  return distance;
}

struct Region {
  double pixels = 0, sum_x = 0, sum_y = 0;
  float max_distance = 0;  // from the border
  double nearest = std::numeric_limits<double>::infinity();
  cv::Point anchor;
  cv::Rect bounds;
};

// The anchor is the pixel nearest to the centroid among those far from the border: the centroid itself lies
// outside of a bent region.
std::vector<Region> anchorRegions(const cv::Mat& labels, int count) {
  std::vector<Region> regions(count + 1);
  const cv::Mat distance = borderDistance(labels);
  for (int y = 0; y < labels.rows; ++y) {
    const auto* label = labels.ptr<std::int32_t>(y);
    const auto* from_border = distance.ptr<float>(y);
    for (int x = 0; x < labels.cols; ++x) {
      Region& region = regions.at(label[x]);
      region.pixels += 1;
      region.sum_x += x;
      region.sum_y += y;
      region.max_distance = std::max(region.max_distance, from_border[x]);
      region.bounds |= cv::Rect(x, y, 1, 1);
    }
  }
  for (int y = 0; y < labels.rows; ++y) {
    const auto* label = labels.ptr<std::int32_t>(y);
    const auto* from_border = distance.ptr<float>(y);
    for (int x = 0; x < labels.cols; ++x) {
      Region& region = regions[label[x]];
      if (from_border[x] < kMinDistance * region.max_distance) continue;
      const double dx = x - region.sum_x / region.pixels, dy = y - region.sum_y / region.pixels;
      if (dx * dx + dy * dy >= region.nearest) continue;
      region.nearest = dx * dx + dy * dy;
      region.anchor = {x, y};
    }
  }
  return regions;
}

// Where a text lies on its region, as near to the anchor as possible; empty if it fits nowhere.
cv::Rect placeOn(const Region& region, const cv::Mat& labels, int label, const std::string& text) {
  const CaptionStyle style = captionStyle(labels.size());
  const cv::Size size = cv::getTextSize(text, style.font, style.scale, style.line, nullptr);
  const int rim = style.rim;
  const cv::Rect inner(rim, rim, labels.cols - 2 * rim, labels.rows - 2 * rim);
  const cv::Rect within = region.bounds & inner;
  if (within.width < size.width || within.height < size.height) return {};
  cv::Mat on_region;  // of the box whose upper left corner is at a pixel
  cv::boxFilter(labels(within) == label, on_region, CV_8U, size, cv::Point(0, 0), /*normalize=*/true,
                cv::BORDER_CONSTANT);
  const cv::Point wanted = region.anchor - cv::Point(size.width / 2, size.height / 2);
  cv::Rect best;
  double nearest = std::numeric_limits<double>::infinity();
  for (int y = 0; y + size.height <= within.height; ++y) {
    for (int x = 0; x + size.width <= within.width; ++x) {
      if (on_region.at<std::uint8_t>(y, x) < kMinOnRegion) continue;
      const cv::Point corner = within.tl() + cv::Point(x, y);
      const double distance = cv::norm(corner - wanted);
      if (distance >= nearest) continue;
      nearest = distance;
      best = cv::Rect(corner, size);
    }
  }
  return best;
}

bool overlaps(const cv::Rect& box, const std::vector<RegionCaption>& captions) {
  const int gap = box.height;
  const cv::Rect around(box.x - gap, box.y - gap, box.width + 2 * gap, box.height + 2 * gap);
  return std::any_of(captions.begin(), captions.end(),
                     [&around](const RegionCaption& other) { return (around & other.box).area() > 0; });
}

}  // namespace

CaptionStyle captionStyle(const cv::Size& picture) {
  const double scale = std::max(kMinScale, kTextHeight * picture.height / kLetterHeight);
  const int line = std::max(1, cvRound(1.5 * scale));
  return {cv::FONT_HERSHEY_SIMPLEX, scale, line, line + 1};
}

std::vector<RegionCaption> captionRegions(const Segmentation& segmentation, double caption_min_area) {
  const cv::Mat& labels = segmentation.labels;
  if (labels.type() != CV_32SC1) throw std::invalid_argument("captions: labels must be CV_32SC1");
  const double least = std::max(1.0, caption_min_area / 100 * static_cast<double>(labels.total()));
  const auto regions = anchorRegions(labels, static_cast<int>(segmentation.segments.size()));
  std::vector<Segment> segments = segmentation.segments;
  std::stable_sort(segments.begin(), segments.end(),
                   [](const Segment& a, const Segment& b) { return a.area > b.area; });
  std::vector<RegionCaption> captions;
  for (const Segment& segment : segments) {
    if (segment.area < least) break;
    const Region& region = regions.at(segment.label);
    RegionCaption caption{segment.label, segment.min_mm, region.anchor, captionText(segment), {}, {}};
    const std::string number = std::to_string(segment.label);
    for (const std::string& written :
         {caption.text, cv::format("%d: %.1f m", segment.label, segment.median_mm / 1e3), number}) {
      caption.written = written;
      caption.box = placeOn(region, labels, segment.label, written);
      if (!caption.box.empty()) break;
    }
    if (caption.box.empty()) caption.written.clear();
    if (!overlaps(caption.box, captions)) captions.push_back(caption);
  }
  return captions;
}

}  // namespace all_in_focus::core
