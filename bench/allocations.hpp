// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace all_in_focus {

/// What the whole program has taken from the heap since it started, in all threads and libraries.
struct Allocations {
  std::uint64_t calls = 0;  ///< of malloc, new and all their like
  std::uint64_t bytes = 0;

  static Allocations soFar();
};

}  // namespace all_in_focus
