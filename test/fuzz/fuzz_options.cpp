// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Values of command line options. What is accepted can be written, and is read as the same again.

#include "all_in_focus/fusion.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

void run(Input& input) {
  const std::string text = input.rest();
  core::Optics optics;
  if (accepts([&] { optics = parseOptics(text); })) {
    validate(optics);
    const std::string again = cv::format("%.17g,%.17g,%.17g", optics.focal_length_mm, optics.aperture,
                                         optics.circle_of_confusion_mm);
    require(parseOptics(again) == optics, "other optics than " + again);
  }
  DofSpan span = DofSpan::kPaper;
  if (accepts([&] { span = parseDofSpan(text); })) require(name(span) == text, "another rule");
  std::vector<int> invalid;
  if (accepts([&] { invalid = parseInvalidValues(text); })) {
    for (const int mm : invalid) require(mm >= 0 && mm <= 65535, "an impossible depth");
  }
  Mode mode = Mode::kPaper;
  if (accepts([&] { mode = parseMode(text); })) require(name(mode) == text, "another mode");
}

std::vector<std::string> seeds() {
  return {"24,4,0.019",   "50.0 , 1.8,\t3e-2", "1e-1,1000,1E-6", "0x18,4,0.019", "nan,inf,-1",
          "24,4,0.019,1", "1e999,4,0.019",     "paper",          "full",         "refined",
          "restored ",    "24;4;0.019",        "0,65535",        ",00000,99999,"};
}

const FuzzTarget target("options", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
