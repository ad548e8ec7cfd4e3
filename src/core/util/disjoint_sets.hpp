// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>

/// Disjoint sets (union-find) as a forest in an array of the caller's: each node names its parent, a root
/// names itself. A node is an integer, the index of its parent, or a struct with a member `parent`.
///
/// The root of a set is always its smallest node, so sets keep the order of their first nodes.
namespace all_in_focus::core {

inline std::int32_t& parentOf(std::int32_t& node) {
  return node;
}
template <typename Node>
auto parentOf(Node& node) -> decltype((node.parent)) {
  return node.parent;
}

/// The root of node i's set. Halves the path on the way. The first step is made in any case, without a
/// branch: after it most nodes have the root for a parent.
template <typename Node>
int findRoot(Node* nodes, int i) {
  const auto step = [nodes](int node) {
    return parentOf(nodes[node]) = parentOf(nodes[parentOf(nodes[node])]);
  };
  int root = step(i);
  while (parentOf(nodes[root]) != root) root = step(root);
  return root;
}

/// Unites the sets of two roots and returns the root that stays, the smaller one.
template <typename Node>
int uniteRoots(Node* nodes, int a, int b) {
  const int root = std::min(a, b);
  parentOf(nodes[a + b - root]) = root;
  return root;
}

/// Numbers the sets of nodes 1..count in the order of their roots: the parent of each node becomes the number
/// of its set, and sets[number] a copy of the root, whose parent is itself. sets needs room for count + 2.
/// Returns the number of sets.
template <typename Node>
int relabelSets(Node* nodes, int count, Node* sets) {
  int found = 0;
  for (int i = 1; i <= count; ++i) {
    const bool is_root = parentOf(nodes[i]) == i;
    // Written for every node, and overwritten unless it was a root: a branch would often be mispredicted.
    sets[found + 1] = nodes[i];
    parentOf(sets[found + 1]) = found + 1;
    found += is_root;
    const int of_parent = parentOf(nodes[parentOf(nodes[i])]);
    parentOf(nodes[i]) = is_root ? found : of_parent;
  }
  return found;
}

}  // namespace all_in_focus::core
