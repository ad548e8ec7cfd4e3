// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/program_options.hpp>
#include <functional>
#include <string>
#include <vector>

#include "stack_batch.hpp"

namespace all_in_focus {

/// How one stack was fused.
struct Fused {
  int used = 0, length = 0;  ///< frames
};

/// Fuses one stack. who: what each line for people begins with; ahead: what a line about progress begins
/// with.
using FuseStack =
    std::function<Fused(const boost::program_options::variables_map& values, const NamedStack& stack,
                        const std::string& who, const std::string& ahead)>;

/// Fuses several stacks, one after the other. The outputs that `values` names are folders: the result of a
/// stack lies there under its name. What an earlier run has fused is left out. A stack that fails does not
/// stop the others; at the end std::invalid_argument tells how many failed. writes: options that name
/// outputs.
void fuseStacks(const boost::program_options::variables_map& values, const std::vector<NamedStack>& stacks,
                const std::vector<const char*>& writes, const FuseStack& fuse);

}  // namespace all_in_focus
