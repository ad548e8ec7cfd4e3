// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/image_rows.hpp"

#include "util/simd.hpp"

namespace all_in_focus::core {

ALL_IN_FOCUS_SIMD void threeTimes(const std::int16_t* values, int n, std::int16_t* __restrict out) {
  for (int i = 0; i < n; ++i) out[3 * i] = out[3 * i + 1] = out[3 * i + 2] = values[i];
}

}  // namespace all_in_focus::core
