// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cstddef>
#include <future>
#include <set>
#include <thread>

#include "lasting_thread.hpp"

using namespace all_in_focus;

namespace {

std::thread::id idOfNext() {
  std::thread::id id;
  runInLastingThread([&] { id = std::this_thread::get_id(); }).wait();
  return id;
}

}  // namespace

TEST(LastingThread, ServesOneCallAfterTheOther) {
  std::set<std::thread::id> ids;
  constexpr std::size_t kCalls = 100;
  for (std::size_t i = 0; i < kCalls; ++i) ids.insert(idOfNext());
  EXPECT_LT(ids.size(), kCalls);  // a thread may still be on its way back when the next call comes
  EXPECT_EQ(ids.count(std::this_thread::get_id()), 0u);
}

TEST(LastingThread, CallsAtTheSameTimeRunBesideEachOther) {
  std::promise<void> both;
  const std::future<void> waiting = runInLastingThread([&] { both.get_future().wait(); });
  runInLastingThread([&] { both.set_value(); }).wait();
  waiting.wait();
}
