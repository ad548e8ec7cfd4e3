// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/drawing.hpp"

#include <algorithm>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "fusion/region_fusion.hpp"

namespace all_in_focus::core {
namespace {

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

}  // namespace

std::vector<cv::Vec3b> labelColors(int count) {
  std::vector<cv::Vec3b> colors = hues(count, 120, true);  // red to blue
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
  const auto write = [&](const RegionCaption& caption, int grey, int thickness) {
    const cv::Point base(caption.box.x, caption.box.y + caption.box.height);
    cv::putText(picture, caption.text, base, style.font, style.scale, cv::Scalar::all(grey), thickness,
                cv::LINE_AA);
  };
  for (const RegionCaption& caption : captions) {
    write(caption, 0, style.line + 2 * style.rim);
    write(caption, 255, style.line);
  }
}

void drawWeights(const cv::Mat& source_index, const cv::Mat& confidence, int frames, cv::Mat& picture) {
  if (source_index.type() != CV_16UC1 || confidence.type() != CV_8UC1 ||
      source_index.size() != confidence.size()) {
    throw std::invalid_argument("drawing: source index must be CV_16UC1 and confidence CV_8UC1, of one size");
  }
  const std::vector<cv::Vec3b> colors = hues(frames, 150, false);  // red to violet
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

}  // namespace all_in_focus::core
