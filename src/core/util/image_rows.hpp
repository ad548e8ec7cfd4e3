// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace all_in_focus::core {

/// Writes each of n values three times: one for each channel of a pixel.
void threeTimes(const std::int16_t* values, int n, std::int16_t* out);

}  // namespace all_in_focus::core
