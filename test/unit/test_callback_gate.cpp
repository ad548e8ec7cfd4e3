// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <stdexcept>

#include "callback_gate.hpp"

using namespace all_in_focus;

TEST(CallbackGate, ClosingWaitsForACallUnderWayAndLetsNoneIn) {
  CallbackGate gate;
  std::promise<void> begun, goes_on;
  const auto call = std::async(std::launch::async, [&] {
    gate.run([&] {
      begun.set_value();
      goes_on.get_future().wait();
    });
  });
  begun.get_future().wait();
  const auto closed = std::async(std::launch::async, [&] { gate.close(); });
  EXPECT_EQ(closed.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  goes_on.set_value();
  EXPECT_EQ(closed.wait_for(std::chrono::seconds(20)), std::future_status::ready);
  gate.run([] { ADD_FAILURE() << "after close()"; });
}

TEST(CallbackGate, ACallThatThrowsHasEnded) {
  CallbackGate gate;
  EXPECT_THROW(gate.run([] { throw std::runtime_error("x"); }), std::runtime_error);
  gate.close();
}
