// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "registration/depth_span.hpp"

namespace all_in_focus::core {

/// The nearest depth of every pixel. Depths are stored less one, so that "none" (0xFFFF) is the farthest,
/// drawing is a minimum, and the order of drawing does not matter. Rows are cleared when they are first drawn
/// to.
///
/// Vectors (here and in depth_span.hpp) take 1.8 ms for 640x480 depth seen in 640x480 pixels and 7.6 ms in
/// 2208x1242; plain loops over the pixels of every footprint's box, with the same result, 5.6 and 12.7 ms
/// (one thread).
///
/// The image has a margin that drawing without branches reads and writes back unchanged: a row below, some
/// columns at the right, and kMost pixels before the first one, where pixels go that are not drawn.
class ZBuffer {
 public:
  /// Clears the image. Keeps the memory if the size is the same as before.
  void begin(const cv::Size& image);

  void drawPoints(const ProjectedSpan& projected, int count);
  void drawFootprints(const DepthSpan& from, const ProjectedSpan& projected);

  /// Row y, depths in mm less one, 0xFFFF = none; nullptr if nothing was drawn to it.
  const std::uint16_t* row(int y) const { return y >= cleared_.start && y < cleared_.end ? at(y) : nullptr; }

 private:
  std::uint16_t* at(int y) const { return origin_ + static_cast<std::ptrdiff_t>(y) * frame_.stride; }
  void clearUpTo(const cv::Range& rows);
  void drawQuads(const QuadSpan& quads, int count);
  void drawBox(int u0, int v0, int u1, int v1, const Footprint& f, float w);

  Frame frame_{{}, 0};
  cv::Mat1w memory_;
  std::uint16_t* origin_ = nullptr;
  cv::Range cleared_;  ///< rows
  bool small_ = true;  ///< the last footprints covered at most 2 x 2 pixels
};

}  // namespace all_in_focus::core
