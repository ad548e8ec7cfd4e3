// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

std::vector<const FuzzTarget*>& targets() {
  static std::vector<const FuzzTarget*> targets;
  return targets;
}

}  // namespace

FuzzTarget::FuzzTarget(const char* name, Run run, Seeds seeds) : name(name), run(run), seeds(seeds) {
  targets().push_back(this);
}

const std::vector<const FuzzTarget*>& FuzzTarget::all() {
  return targets();
}

}  // namespace all_in_focus::fuzz
