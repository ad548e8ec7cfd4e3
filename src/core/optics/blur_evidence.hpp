// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "optics/disc_blur.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {

/// How well each frame of a bracket, tile by tile, looks like the fused picture blurred by discs of each
/// radius. It is measured once; then any lens and any list of focus distances can be asked how much of what
/// the frames show it explains.
class BlurEvidence {
 public:
  /// A small copy of a frame, in the geometry and exposure of the fused picture.
  struct Frame {
    cv::Mat1f gray;  ///< codes
    cv::Rect seen;   ///< other pixels are not valid
  };

  /// Factor by which pictures are shrunk to copies of about so many pixels, and such a copy.
  static double shrinking(const cv::Size& size, double pixels);
  static cv::Mat copyOf(const cv::Mat& image, double shrinking);

  /// inverse_depth: 1/mm as a sensor measured it, 0 = unknown; or empty. All of the frames' size. shrinking:
  /// how many times as wide the pictures were from which these copies are made.
  BlurEvidence(const cv::Mat1b& fused, const std::vector<Frame>& frames, const LightCurve& curve,
               const cv::Mat1f& inverse_depth, double shrinking);

  /// Share of the blur in the frames that a lens explains: 1 = as much as if each tile of each frame had a
  /// disc of its own, 0 = no more than without blur; negative: less. The depth of a tile is one of those
  /// measured in it, where there are some, and else any: the one that suits this lens best. blur: of each
  /// frame, in pixels before it was shrunk; scale: factor on radii.
  double explained(const std::vector<FrameBlur>& blur, double scale) const;

  /// The scale, up to twice as large or small as `near`, at which a tile of measured depth is explained best:
  /// the median of all, weighted by how much it explains. Where depth is wrong in some tiles, it is less
  /// biased than the scale that explains most. There must be depth.
  double typicalScale(const std::vector<FrameBlur>& blur, double near) const;

  /// Whether the frames differ in blur at all, beyond noise.
  bool showsBlur() const;

  bool hasDepth() const { return has_depth_; }

  /// The same without what was measured.
  BlurEvidence withoutDepth() const;

 private:
  struct Tile {
    std::vector<float> depths;               // inverse, those measured in it; empty: any
    float middle = 0;                        // their median
    std::vector<std::vector<float>> errors;  // by frame and radius; empty: the frame has not seen it
  };
  void sumErrors();
  double error(const Tile& tile, const std::vector<FrameBlur>& blur, double scale,
               double inverse_depth) const;

  double pixels_;  // of the pictures in one pixel of their copies
  std::vector<Tile> tiles_;
  bool has_depth_ = false;
  int compared_ = 0;                  // tiles of frames
  double unblurred_ = 0, least_ = 0;  // errors without blur, and with the disc that suits best
};

}  // namespace all_in_focus::core
