// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "restoration/disc_blur.hpp"
#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {

/// How a pixel of a blurred frame is made of the pixels of the sharp picture: each spreads its light over its
/// own blur disc, and what lies nearer covers what lies behind it.
class ImageFormation {
 public:
  /// A pixel of the sharp picture, relative to the one it lights up.
  struct Part {
    std::int16_t dx, dy;
    float share;
  };

  /// closeness: shared, not copied; may change by what moves jumps by a pixel or two before the next
  /// update(). The first one must come before anything else. layer_gap: pixels whose closeness differs by
  /// less do not cover each other.
  ImageFormation(const cv::Mat1f& closeness, const FrameBlur& blur, float layer_gap);

  /// Follows the closeness: all that is needed, or only what changed in a few pixels.
  void update();
  void update(const std::vector<cv::Point>& changed);

  /// What lights up pixel p, if its closeness were `own`; shares sum up to 1. Nearest layers first: they take
  /// what their discs take, the last one takes the rest. What is missing then, because it is hidden in the
  /// sharp picture, is taken from farther pixels nearby.
  void partsOf(const cv::Point& p, float own, std::vector<Part>& parts) const;

  float closeness(const cv::Point& p) const { return closeness_(p); }
  float radius(const cv::Point& p) const { return blur_.radius(closeness_(p)); }

 private:
  static constexpr int kLayers = 64;

  int layer(float closeness) const {
    return std::clamp(static_cast<int>((closeness - least_) * per_layer_), 0, kLayers - 1);
  }
  float gather(const cv::Point& p, int own_index, int own_layer, int half, std::vector<Part>& parts) const;
  void fillUp(const cv::Point& p, int own_layer, float missing, std::vector<Part>& parts) const;

  cv::Mat1f closeness_;
  FrameBlur blur_;
  float least_ = 0, per_layer_ = 0;
  cv::Mat1b index_, layer_;  // by pixel: disc kernel and layer
  cv::Mat1b reach_;          // how far away, px, pixels may lie that light up this one
  cv::Mat1b nearest_;        // the nearest layer among them
};

void updateAll(std::vector<ImageFormation>& formation);

}  // namespace all_in_focus::core
