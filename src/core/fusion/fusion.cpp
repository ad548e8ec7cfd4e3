// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/fusion.hpp"

#include <stdexcept>

namespace all_in_focus::core {

const char* name(Mode mode) {
  return mode == Mode::kPaper ? "paper" : mode == Mode::kRefined ? "refined" : "restored";
}

Mode parseMode(const std::string& text) {
  for (const Mode mode : {Mode::kPaper, Mode::kRefined, Mode::kRestored}) {
    if (text == name(mode)) return mode;
  }
  throw std::invalid_argument("mode '" + text + "' is none of paper, refined, restored");
}

}  // namespace all_in_focus::core
