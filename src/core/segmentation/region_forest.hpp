// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace all_in_focus::core {

/// Node of a union-find forest. Depths (mm) hold at roots.
struct RegionNode {
  int parent;
  std::uint16_t min, max;
};

/// Halves the path once in any case: most nodes then have a root for parent, and no branch is guessed wrong.
inline int findRoot(RegionNode* nodes, int i) {
  int root = nodes[i].parent = nodes[nodes[i].parent].parent;
  while (nodes[root].parent != root) root = nodes[root].parent = nodes[nodes[root].parent].parent;
  return root;
}

/// The smaller root stays: numbers keep the order of the first pixels.
inline void uniteRoots(RegionNode* nodes, int a, int b) {
  const int smaller = a < b ? a : b;
  RegionNode &to = nodes[smaller], &from = nodes[a + b - smaller];
  from.parent = smaller;
  to.min = from.min < to.min ? from.min : to.min;
  to.max = from.max > to.max ? from.max : to.max;
}

/// Turns the parents of nodes 1..count into the numbers of their trees, and describes tree i, a root, in
/// trees[i]. Returns the number of trees.
inline int numberTrees(RegionNode* nodes, int count, RegionNode* trees) {
  int found = 0;
  for (int i = 1; i <= count; ++i) {
    const bool root = nodes[i].parent == i;
    // Written in any case: without a branch.
    trees[found + 1] = {found + 1, nodes[i].min, nodes[i].max};
    found += root;
    const int number = nodes[nodes[i].parent].parent;
    nodes[i].parent = root ? found : number;
  }
  return found;
}

}  // namespace all_in_focus::core
