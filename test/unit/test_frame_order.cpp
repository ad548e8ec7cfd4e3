// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "all_in_focus/frame_order.hpp"

using namespace all_in_focus::core;

namespace {

struct Fused {
  std::vector<int> order;
  std::vector<int> held;  // frames after whose arrival the order waits for the reference
};

void fuseReady(FrameOrder& order, const std::set<int>& broken, Fused& fused) {
  while (const std::optional<int> turn = order.next()) {
    const bool used = broken.count(*turn) == 0;
    if (used) fused.order.push_back(*turn);
    order.done(*turn, used);
  }
}

// Frames in their order, `last` announces the end with the last one. Broken frames are refused when their
// turn comes.
Fused fuse(FrameOrder order, const std::vector<int>& frames, bool last = false,
           const std::set<int>& broken = {}) {
  Fused fused;
  for (const int frame : frames) {
    order.arrived(frame, last && frame == frames.back());
    if (order.isHolding()) fused.held.push_back(frame);
    fuseReady(order, broken, fused);
  }
  order.close();
  fuseReady(order, broken, fused);
  return fused;
}

using Indices = std::vector<int>;

}  // namespace

TEST(FrameOrder, ModePaperTakesFramesAsTheyArrive) {
  const Fused fused = fuse(FrameOrder(Mode::kPaper, 2), {0, 1, 2, 3});
  EXPECT_EQ(fused.order, (Indices{0, 1, 2, 3}));
  EXPECT_TRUE(fused.held.empty());
}

TEST(FrameOrder, ModeRefinedTakesTheReferenceFirst) {
  const Fused fused = fuse(FrameOrder(Mode::kRefined, 2), {0, 1, 2, 3, 4});
  EXPECT_EQ(fused.order, (Indices{2, 0, 1, 3, 4}));
  EXPECT_EQ(fused.held, (Indices{0, 1}));
}

TEST(FrameOrder, TheFirstFrameAsReferenceNeedsNoWaiting) {
  const Fused fused = fuse(FrameOrder(Mode::kRefined, 0), {0, 1, 2});
  EXPECT_EQ(fused.order, (Indices{0, 1, 2}));
  EXPECT_TRUE(fused.held.empty());
}

TEST(FrameOrder, TheNearestFrameStandsInForALostReference) {
  EXPECT_EQ(fuse(FrameOrder(Mode::kRefined, 2), {0, 1, 3, 4}).order,
            (Indices{1, 0, 3, 4}));  // of two the first
  EXPECT_EQ(fuse(FrameOrder(Mode::kRefined, 2), {0, 3, 4}).order, (Indices{3, 0, 4}));
  EXPECT_EQ(fuse(FrameOrder(Mode::kRefined, 5), {0, 1, 2}).order, (Indices{2, 0, 1}));
}

TEST(FrameOrder, TheNearestUsableFrameStandsInForABrokenReference) {
  EXPECT_EQ(fuse(FrameOrder(Mode::kRefined, 2), {0, 1, 2, 3}, false, {2}).order, (Indices{1, 0, 3}));
  EXPECT_EQ(fuse(FrameOrder(Mode::kRefined, 1), {0, 1, 2}, false, {0, 1}).order, (Indices{2}));
}

TEST(FrameOrder, TheLastFrameEndsTheWaiting) {
  FrameOrder order(Mode::kRefined, 9);
  order.arrived(0);
  EXPECT_FALSE(order.next());
  order.arrived(1, /*last=*/true);
  EXPECT_FALSE(order.isHolding());
  EXPECT_EQ(order.next(), 1);
}

TEST(FrameOrder, AFrameThatIsRefusedWhileHeldIsForgotten) {
  FrameOrder order(Mode::kRefined, 2);
  order.arrived(0);
  order.arrived(1);
  order.done(1, false);
  order.close();
  EXPECT_EQ(order.next(), 0);
}
