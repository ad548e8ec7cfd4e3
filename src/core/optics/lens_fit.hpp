// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "all_in_focus/optics.hpp"
#include "optics/blur_evidence.hpp"

namespace all_in_focus::core {

/// The mistakes that people make with focus distances.
struct FocusCorrection {
  bool reversed = false;  ///< the list begins at its other end
  int shift = 0;          ///< frames by which the list is late
  double factor = 1;      ///< on the distances

  bool isNone() const { return !reversed && shift == 0 && factor == 1; }
  /// given: of each frame, in the order of the list.
  std::vector<FrameBlur> of(const std::vector<FrameBlur>& given) const;
};

/// What the frames say about a lens and its focus distances.
struct LensFit {
  static constexpr double kBelieved = 0.7;  ///< share that must be explained, else the frames contradict
  static constexpr double kTrusted = 0.85;  ///< the same for a correction that only some frames show

  FocusCorrection focus;
  double scale = 1;      ///< factor on the radii; 1 where the frames do not contradict
  double explained = 1;  ///< share of the blur that this explains, see BlurEvidence

  bool shows_blur = true;  ///< false: the frames show none, so that they say nothing
  bool is_certain = true;  ///< false: f-number or focus distances are wrong, the frames do not show which
  bool uses_depth = true;  ///< false: the depth that was measured contradicts the frames, whatever the lens

  bool contradicts() const { return explained < kBelieved; }

  /// What is wrong with the numbers, a line each; empty: nothing.
  std::vector<std::string> notes(const Optics& optics) const;
};

/// Corrects one mistake at most. Numbers that explain nearly as much as the best stay as they are. given: of
/// each frame, in the order of the bracket. voted: what the focus distances are known to need, and nothing
/// else. has_scale: its px_mm are more than a guess.
LensFit fitLens(const BlurEvidence& evidence, const std::vector<FrameBlur>& given,
                const std::optional<FocusCorrection>& voted, bool has_scale);

/// The same. Where its result contradicts the frames, two mistakes at once are tried, then any depth in place
/// of the measured one. That takes many times as long.
LensFit fitWrongLens(const BlurEvidence& evidence, const std::vector<FrameBlur>& given, bool has_scale);

}  // namespace all_in_focus::core
