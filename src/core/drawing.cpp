// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/drawing.hpp"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "all_in_focus/fusion.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kFarHue = 120;  // blue; near is red

// `count` colours, the first of hue 0 (red), the last of hue `span`, in OpenCV's unit of two degrees.
// alternate: every other colour is darker.
std::vector<cv::Vec3b> hues(int count, double span, bool alternate) {
  cv::Mat hsv(1, std::max(count, 1), CV_8UC3), bgr;
  for (int i = 0; i < hsv.cols; ++i) {
    const double hue = count > 1 ? span * i / (count - 1) : 0;
    const int value = alternate && i % 2 == 1 ? 180 : 255;
    hsv.at<cv::Vec3b>(0, i) =
        cv::Vec3b(cv::saturate_cast<std::uint8_t>(hue), 220, cv::saturate_cast<std::uint8_t>(value));
  }
  cv::cvtColor(hsv, bgr, cv::COLOR_HSV2BGR);
  return {bgr.begin<cv::Vec3b>(), bgr.end<cv::Vec3b>()};
}

// A strip of colours from near to far, evenly in dioptres, with metres below it. color: of a depth, mm; none:
// the strip is white.
cv::Mat drawLegend(int width, double near_mm, double far_mm, const std::function<cv::Vec3b(double)>& color) {
  constexpr int kMostTicks = 5;
  const double scale = std::max(0.3, width / 1100.0);
  const int line = std::max(1, cvRound(width / 900.0)), bar = std::max(6, width / 40),
            gap = std::max(2, bar / 4);
  const auto text_size = [&](const std::string& text) {
    return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, line, nullptr);
  };
  cv::Mat legend(bar + text_size("0").height + 3 * gap, width, CV_8UC3, cv::Scalar::all(255));
  if (!color) return legend;
  const auto depth_at = [&](double share) { return 1 / (1 / near_mm + share * (1 / far_mm - 1 / near_mm)); };
  for (int x = 0; x < width; ++x) legend(cv::Rect(x, gap, 1, bar)).setTo(color(depth_at((x + 0.5) / width)));
  const int fitting = width / (2 * text_size("8.88 m").width);
  const int ticks = near_mm == far_mm ? 1 : std::clamp(fitting, 2, kMostTicks);
  for (int i = 0; i < ticks; ++i) {
    const double share = ticks > 1 ? static_cast<double>(i) / (ticks - 1) : 0;
    const std::string text = cv::format("%.3g m", depth_at(share) / 1000);
    const int left = cvRound(share * (width - text_size(text).width));
    cv::putText(legend, text, {left, legend.rows - gap}, cv::FONT_HERSHEY_SIMPLEX, scale, cv::Scalar::all(40),
                line, cv::LINE_AA);
  }
  return legend;
}

// Of the frames in drawWeights(): red to violet.
std::vector<cv::Vec3b> frameColors(int frames) {
  return hues(frames, 150, false);
}

}  // namespace

std::vector<cv::Vec3b> labelColors(int count) {
  std::vector<cv::Vec3b> colors = hues(count, kFarHue, true);
  colors.insert(colors.begin(), cv::Vec3b(0, 0, 0));
  return colors;
}

void drawLabels(const cv::Mat& labels, int count, cv::Mat& picture) {
  if (labels.type() != CV_32SC1) throw std::invalid_argument("drawing: labels must be CV_32SC1");
  const std::vector<cv::Vec3b> colors = labelColors(count);
  const int last = static_cast<int>(colors.size()) - 1;
  picture.create(labels.size(), CV_8UC3);
  for (int y = 0; y < labels.rows; ++y) {
    const auto* from = labels.ptr<std::int32_t>(y);
    auto* to = picture.ptr<cv::Vec3b>(y);
    for (int x = 0; x < labels.cols; ++x) to[x] = colors[std::clamp(from[x], 0, last)];
  }
}

void drawCaptions(const std::vector<RegionCaption>& captions, cv::Mat& picture) {
  if (picture.type() != CV_8UC3) throw std::invalid_argument("drawing: captions go on a CV_8UC3 picture");
  const CaptionStyle style = captionStyle(picture.size());
  const auto write = [&](const RegionCaption& caption, int gray, int thickness) {
    const cv::Point base(caption.box.x, caption.box.y + caption.box.height);
    cv::putText(picture, caption.written, base, style.font, style.scale, cv::Scalar::all(gray), thickness,
                cv::LINE_AA);
  };
  for (const RegionCaption& caption : captions) {
    write(caption, 0, style.line + 2 * style.rim);
    write(caption, 255, style.line);
  }
}

void drawRegions(const Segmentation& segmentation, const std::vector<RegionCaption>& captions,
                 cv::Mat& picture) {
  const std::vector<Segment>& segments = segmentation.segments;
  cv::Mat regions;
  drawLabels(segmentation.labels, static_cast<int>(segments.size()), regions);
  drawCaptions(captions, regions);
  if (segments.empty()) {
    cv::vconcat(regions, drawLegend(regions.cols, 0, 0, nullptr), picture);
    return;
  }
  double near = segments.front().min_mm, far = segments.front().max_mm;
  for (const Segment& segment : segments) {
    near = std::min<double>(near, segment.min_mm);
    far = std::max<double>(far, segment.max_mm);
  }
  const std::vector<cv::Vec3b> colors = labelColors(static_cast<int>(segments.size()));
  const auto color = [&](double mm) {  // of the region with the nearest median; they ascend
    const auto above =
        std::lower_bound(segments.begin(), segments.end(), mm,
                         [](const Segment& segment, double at) { return segment.median_mm < at; });
    if (above == segments.begin()) return colors[1];
    const auto below = above - 1;
    const bool take_below = above == segments.end() || mm - below->median_mm < above->median_mm - mm;
    return colors[(take_below ? below : above)->label];
  };
  cv::vconcat(regions, drawLegend(regions.cols, near, far, color), picture);
}

void drawWeights(const cv::Mat& source_index, const cv::Mat& confidence, int frames, cv::Mat& picture) {
  if (source_index.type() != CV_16UC1 || confidence.type() != CV_8UC1 ||
      source_index.size() != confidence.size()) {
    throw std::invalid_argument("drawing: source index must be CV_16UC1 and confidence CV_8UC1, of one size");
  }
  const std::vector<cv::Vec3b> colors = frameColors(frames);
  const int last = static_cast<int>(colors.size()) - 1;
  picture.create(source_index.size(), CV_8UC3);
  for (int y = 0; y < picture.rows; ++y) {
    const auto* index = source_index.ptr<std::uint16_t>(y);
    const auto* sure = confidence.ptr<std::uint8_t>(y);
    auto* to = picture.ptr<cv::Vec3b>(y);
    for (int x = 0; x < picture.cols; ++x) {
      if (index[x] == kNoFrame) {
        to[x] = cv::Vec3b(0, 0, 0);
        continue;
      }
      // Confidence 0 still has half the brightness, so that the hue can be seen.
      const cv::Vec3b& color = colors[std::min<int>(index[x], last)];
      const int gain = 128 + sure[x] / 2;
      for (int c = 0; c < 3; ++c) to[x][c] = static_cast<std::uint8_t>(color[c] * gain / 255);
    }
  }
}

void drawWeightsLegend(const std::vector<std::string>& frames, cv::Mat& picture) {
  constexpr int kMost = 60, kRows = 20, kFont = cv::FONT_HERSHEY_SIMPLEX, kLine = 24;
  constexpr double kScale = 0.5;
  const int count = static_cast<int>(frames.size()), shown = std::min(count, kMost);
  const std::vector<cv::Vec3b> colors = frameColors(count);
  int widest = 0;
  for (const std::string& text : frames)
    widest = std::max(widest, cv::getTextSize(text, kFont, kScale, 1, nullptr).width);
  const int column = widest + 3 * kLine, columns = std::max(1, (shown + kRows - 1) / kRows);
  picture = cv::Mat(std::max(1, std::min(shown, kRows)) * kLine + kLine / 2, columns * column, CV_8UC3,
                    cv::Scalar::all(255));
  for (int i = 0; i < shown; ++i) {
    const int frame = shown > 1 ? cvRound(static_cast<double>(i) * (count - 1) / (shown - 1)) : 0;
    const cv::Rect patch(i / kRows * column + kLine / 2, i % kRows * kLine + kLine / 2, kLine, kLine * 2 / 3);
    picture(patch).setTo(colors[frame]);
    cv::putText(picture, frames[frame], {patch.x + kLine * 3 / 2, patch.y + patch.height - 2}, kFont, kScale,
                cv::Scalar::all(40), 1, cv::LINE_AA);
  }
}

}  // namespace all_in_focus::core
