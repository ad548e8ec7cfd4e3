// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The YAML of focus distances, with and without the names of a stack.

#include <cmath>
#include <sstream>

#include "rig_files.hpp"
#include "scratch_folder.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

constexpr char kMark = '\f';  // after the names, which stand in lines

void run(Input& input) {
  static const ScratchFolder folder;
  std::istringstream lines(input.numberUpTo(kMark));
  std::vector<std::string> names;
  for (std::string name; std::getline(lines, name);) names.push_back(name);
  const std::string path = folder.write("focus.yaml", input.rest());
  std::vector<double> focus;
  if (!accepts([&] { focus = readFocus(path, names); })) return;
  require(names.empty() || focus.size() == names.size(), "not one distance for each name");
  for (const double mm : focus) require(mm > 0 || std::isnan(mm), "a distance that is not positive");
}

std::vector<std::string> seeds() {
  const std::string mark(1, kMark);
  const std::string whole =
      "frames: [{file: 00.png, focus_mm: 855.0}, {file: stack/01.png, focus_mm: .inf}, "
      "{file: 02.png, focus_mm: ~}]\n";
  return {"00.png\n01.png\n02.png\n" + mark + whole,
          mark + whole,
          "00.png" + mark + whole,
          "a b.jpg\n" + mark + "frames:\n- file: 'a b.jpg'\n  focus_mm: 1e3\n- {file: a b.jpg, focus_mm: 2}",
          mark + "frames:\n- focus_mm: -1\n",
          mark + "frames: {focus_mm: 1}",
          mark + "&a [*a]",
          mark + "frames: &a\n- focus_mm: .nan\n- focus_mm: 0x10\n- *a\n"};
}

const FuzzTarget target("focus", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
