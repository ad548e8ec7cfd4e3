// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>

namespace all_in_focus::core {

/// cv::saturate_cast<std::uint8_t>(value), which rounds half to even, in a form that compilers vectorise.
/// |value| < 2^22.
inline std::uint8_t roundToCode(float value) {
  constexpr float kInteger = 3 << 22;  // floats near it have no fraction, so that adding it rounds
  const int code = static_cast<int>((value + kInteger) - kInteger);
  return static_cast<std::uint8_t>(std::min(std::max(code, 0), 255));
}

}  // namespace all_in_focus::core
