// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Headers of .oni recordings.

#include "kinect_recording.hpp"
#include "scratch_folder.hpp"
#include "target.hpp"
#include "unit/oni_bytes.hpp"

namespace all_in_focus::fuzz {
namespace {

void run(Input& input) {
  static const ScratchFolder folder;
  const std::string path = folder.write("x.oni", input.rest());
  accepts<std::runtime_error>([&] { requireRecording(path); });
}

std::vector<std::string> seeds() {
  using namespace oni;
  std::string old = kWhole;
  old[6] = 0;
  return {kWhole,
          old,
          fileHeader(1, 1, 0) + record(2, textOf("Depth") + "12345678"),
          fileHeader() + added(0, 0xffffffff) + kImage,
          fileHeader() + added(100, 1) + kImage + std::string(200, '\0'),
          fileHeader() + added(0, 0) + record(14, "") + record(7, "") + record(11, "", 0)};
}

const FuzzTarget target("recording", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
