// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "registration/depth_span.hpp"

namespace all_in_focus::core {

/// The nearest depth of every pixel, less one so that "none" (0xFFFF) is the farthest and drawing is a
/// minimum: the order of drawing does not matter. Rows are cleared when they are first reached. Around the
/// image lies what branch-free drawing touches without changing it: a row below, some columns at the right,
/// and a stretch ahead where pixels go that are not drawn.
class ZBuffer {
 public:
  /// Keeps its memory where the size stays. No row has been reached afterwards.
  void begin(const cv::Size& image);

  void drawPoints(const ProjectedSpan& projected, int count);
  void drawFootprints(const DepthSpan& from, const ProjectedSpan& projected);

  /// What was drawn into row y, or nullptr where nothing was.
  const std::uint16_t* row(int y) const { return y >= top_ && y < bottom_ ? at(y) : nullptr; }

 private:
  std::uint16_t* at(int y) const { return origin_ + static_cast<std::ptrdiff_t>(y) * frame_.stride; }
  void reach(const RowRange& rows);
  void drawQuads(const QuadSpan& quads, int count);
  void drawBox(int u0, int v0, int u1, int v1, const Footprint& footprint, float w);

  Frame frame_{{}, 0};
  cv::Mat1w memory_;
  std::uint16_t* origin_ = nullptr;
  int top_ = 0, bottom_ = 0;  ///< rows reached: from top to above bottom
  bool small_ = true;         ///< the last footprints were at most 2x2 pixels
};

}  // namespace all_in_focus::core
