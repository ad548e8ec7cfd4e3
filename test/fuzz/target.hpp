// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "input.hpp"

namespace all_in_focus::fuzz {

/// A part of the product, and what must hold for it whatever its input is. Each source file of a target
/// defines one. libfuzzer_main.cpp looks for inputs that break it; test_fuzz_targets.cpp, one of the unit
/// tests, runs it on its seeds and changes of them.
struct FuzzTarget {
  using Run = void (*)(Input&);
  using Seeds = std::vector<std::string> (*)();

  FuzzTarget(const char* name, Run run, Seeds seeds);

  static const std::vector<const FuzzTarget*>& all();  ///< of this program

  const char* name;
  Run run;      ///< throws Finding if something does not hold
  Seeds seeds;  ///< inputs to begin with, which reach what random bytes would hardly find
};

/// Something that must hold does not. No std::runtime_error or std::logic_error, which targets expect.
class Finding : public std::exception {
 public:
  explicit Finding(std::string what) : what_(std::move(what)) {}
  const char* what() const noexcept override { return what_.c_str(); }

 private:
  std::string what_;
};

inline void require(bool holds, const std::string& what) {
  if (!holds) throw Finding(what);
}

/// Runs a call that may refuse its input with an Error that says why, and do nothing else. False: it refused.
template <typename Error = std::invalid_argument, typename Call>
bool accepts(const Call& call) {
  try {
    call();
    return true;
  } catch (const Error& e) {
    require(e.what()[0] != 0, "refused without a reason");
    return false;
  }
}

}  // namespace all_in_focus::fuzz
