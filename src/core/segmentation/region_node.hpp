// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>

#include "util/disjoint_sets.hpp"

namespace all_in_focus::core {

/// Node of the disjoint sets of zones, and of regions. A root has the depth range of its set, mm.
struct RegionNode {
  int parent;
  std::uint16_t min, max;
};

/// Merges the regions of two roots.
inline void mergeRoots(RegionNode* nodes, int a, int b) {
  const int root = uniteRoots(nodes, a, b);
  const RegionNode& other = nodes[a + b - root];
  nodes[root].min = std::min(nodes[root].min, other.min);
  nodes[root].max = std::max(nodes[root].max, other.max);
}

}  // namespace all_in_focus::core
