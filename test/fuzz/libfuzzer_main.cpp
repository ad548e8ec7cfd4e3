// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// One target as a program of libFuzzer: PROGRAM --seeds DIR writes its seeds, PROGRAM FILE runs one input,
// PROGRAM CORPUS... looks for inputs that break it.

#include <cstdlib>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <opencv2/core/utils/logger.hpp>

#include "target.hpp"

using all_in_focus::fuzz::FuzzTarget;

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  cv::setNumThreads(1);  // targets ask for more where it matters
  if (*argc != 3 || std::string((*argv)[1]) != "--seeds") return 0;
  int number = 0;
  for (const std::string& seed : FuzzTarget::all().front()->seeds()) {
    std::ofstream((*argv)[2] + ("/seed_" + std::to_string(number++)), std::ios::binary) << seed;
  }
  std::exit(0);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  all_in_focus::fuzz::Input input(data, size);
  FuzzTarget::all().front()->run(input);
  return 0;
}
