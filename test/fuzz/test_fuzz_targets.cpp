// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Every fuzz target on its seeds and on simple changes of them: what the fuzzer looks for by the billion, in
// a second. Without libFuzzer, so that every compiler and every run of the tests has it.

#include <gtest/gtest.h>

#include <opencv2/core/utils/logger.hpp>
#include <random>

#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

constexpr int kChangesOfASeed = 25;

// A changed, lost or doubled piece, or an end.
std::string changed(std::string bytes, std::mt19937& random) {
  const auto below = [&random](std::size_t count) { return random() % count; };
  for (std::size_t i = 0; i <= below(4) && !bytes.empty(); ++i) {
    const std::size_t at = below(bytes.size());
    switch (below(5)) {
      case 0:
        bytes[at] = static_cast<char>(random());
        break;
      case 1:
        bytes[at] = static_cast<char>(bytes[at] ^ 1 << below(8));
        break;
      case 2:
        bytes.erase(at, 1 + below(8));
        break;
      case 3:
        bytes.insert(at, bytes.substr(below(bytes.size()), 1 + below(8)));
        break;
      default:
        bytes.resize(at);
    }
  }
  return bytes;
}

void run(const FuzzTarget& target, const std::string& bytes) {
  Input input(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  try {
    target.run(input);
  } catch (const std::exception& e) {
    ADD_FAILURE() << e.what() << "; input: " << testing::PrintToString(bytes);
  }
}

class Targets : public testing::TestWithParam<const FuzzTarget*> {};

TEST_P(Targets, HoldOnSeedsAndChangesOfThem) {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  const FuzzTarget& target = *GetParam();
  const std::vector<std::string> seeds = target.seeds();
  ASSERT_FALSE(seeds.empty());
  std::mt19937 random(1);
  run(target, "");
  for (const std::string& seed : seeds) {
    run(target, seed);
    for (int i = 0; i < kChangesOfASeed; ++i) run(target, changed(seed, random));
  }
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Targets, testing::ValuesIn(FuzzTarget::all()),
                         [](const auto& info) { return info.param->name; });

}  // namespace
}  // namespace all_in_focus::fuzz
