// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "optics/disc_blur.hpp"
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

  /// inverse_depth: shared, not copied. Call update() before anything else, and again before its jumps have
  /// moved by more than two pixels. layer_gap: pixels whose inverse depth differs by less do not cover each
  /// other.
  ImageFormation(const cv::Mat1f& inverse_depth, const FrameBlur& blur, float layer_gap);

  /// Takes over the inverse depth: of all pixels, or only of those that have changed.
  void update();
  void update(const std::vector<cv::Point>& changed);

  /// What lights up pixel p, if its inverse depth were `own`; shares sum up to 1. Nearest layers first: they
  /// take what their discs take, the last one takes the rest. What is missing then, because it is hidden in
  /// the sharp picture, is taken from farther pixels nearby.
  void partsOf(const cv::Point& p, float own, std::vector<Part>& parts) const;

  /// Light of the sharp picture as predict() reads it: a margin on all sides mirrors it.
  static cv::Mat4f withMargin(const cv::Mat3f& light);

  /// A pixel of the blurred frame as its parts add up.
  struct Prediction {
    cv::Vec3f light;
    float own_share = 1;  ///< of the same pixel of the sharp picture in it
  };

  /// Predicts pixel p, if its inverse depth were `own`. sharp: see withMargin().
  Prediction predict(const cv::Point& p, float own, const cv::Mat4f& sharp) const;

  float inverseDepth(const cv::Point& p) const { return inverse_depth_(p); }
  float radius(const cv::Point& p) const { return blur_.radius(inverse_depth_(p)); }

 private:
  static constexpr int kLayers = 64;
  // Of all images that have a margin, px: no disc reaches farther, nor does a block of columns behind it.
  static constexpr int kMargin = 2 * DiscKernels::kSide;

  struct Candidate;
  struct Lights;
  struct Hidden;

  int layer(float inverse_depth) const {
    return std::clamp(static_cast<int>((inverse_depth - least_) * per_layer_), 0, kLayers - 1);
  }
  Candidate candidate(float inverse_depth) const;
  template <typename Visit>
  void forEachThatLightsUp(const cv::Point& p, int half, const Visit& visit) const;
  template <typename Visit>
  float forEachPart(const cv::Point& p, float own, const Visit& visit) const;
  void gather(const cv::Point& p, const Candidate& own, int half, Lights& lights) const;
  Hidden hiddenAt(const cv::Point& p, int own_layer) const;

  cv::Mat1f inverse_depth_;
  FrameBlur blur_;
  float least_ = 0, per_layer_ = 0;
  cv::Mat1b index_, layer_;  // by pixel, with a margin: disc kernel and layer
  cv::Mat1b reach_;          // how far away, px, pixels may lie that light up this one
  cv::Mat1b nearest_;        // the nearest layer among them
};

void updateAll(std::vector<ImageFormation>& formation);

}  // namespace all_in_focus::core
