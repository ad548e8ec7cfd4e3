// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <boost/make_shared.hpp>
#include <string>

#include "bracket_assembler.hpp"

using namespace all_in_focus;

namespace {

BracketFrame at(double stamp_s) {
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = ros::Time(stamp_s);
  return {image, nullptr};
}

BracketFrame focus(std::uint32_t id, std::uint32_t index, std::uint32_t count = 0, bool last = false) {
  const auto message = boost::make_shared<FocusFrame>();
  message->bracket_id = id;
  message->index = index;
  message->count = count;
  message->last = last;
  return {at(0).image, message};
}

BracketAssembler::Step last_step;  // of feed()

// What becomes of a frame, as letters: ) closes the bracket before, ( begins, a digit is the index, x
// refused; ] the bracket has ended with it.
std::string feed(BracketAssembler& assembler, const BracketFrame& frame) {
  std::string story;
  if (assembler.endsBefore(frame)) {
    story += ')';
    assembler.close();
  }
  const BracketAssembler::Step& step = last_step = assembler.add(frame);
  if (step.begin) story += '(';
  story += step.use ? std::to_string(step.frame.index) : "x";
  EXPECT_TRUE(!step.use || step.reason.empty());
  if (step.frame.last) story += ']';
  return story;
}

TEST(BracketAssembler, BracketByFocusFrame) {
  BracketAssembler a;
  EXPECT_EQ(feed(a, focus(7, 0, 3)), "(0");
  EXPECT_EQ(last_step.frame.count, 3u);
  EXPECT_EQ(feed(a, focus(7, 1, 3)), "1");
  EXPECT_EQ(feed(a, focus(7, 2, 3)), "2]");
  EXPECT_EQ(last_step.frame.bracket_id, 7u);
  EXPECT_EQ(last_step.missing, 0);
  EXPECT_EQ(feed(a, focus(7, 2, 3)), "x");  // late
}

TEST(BracketAssembler, ABracketThatHadBegunIsNamed) {
  BracketAssembler a;
  for (const std::uint32_t index : {1u, 2u}) {
    EXPECT_EQ(feed(a, focus(7, index)), "x");
    EXPECT_NE(last_step.reason.find("bracket 7 had begun before anybody listened"), std::string::npos);
  }
  EXPECT_EQ(feed(a, focus(8, 0)), "(0");
}

TEST(BracketAssembler, ABracketWhoseBeginningWasAnnouncedMayLackItsFirstFrame) {
  BracketAssembler a;
  a.announce(7);
  EXPECT_EQ(feed(a, focus(7, 1, 3)), "(1");
  EXPECT_EQ(last_step.missing, 1);
  EXPECT_EQ(feed(a, focus(7, 2, 3)), "2]");
  a.restart();
  EXPECT_EQ(feed(a, focus(7, 1, 3)), "x");
}

TEST(BracketAssembler, LastEndsAnOpenBracket) {
  BracketAssembler a;
  EXPECT_EQ(feed(a, focus(1, 0)), "(0");
  EXPECT_EQ(feed(a, focus(1, 1, 0, true)), "1]");
}

TEST(BracketAssembler, ANewIdClosesTheOneBeforeAndMissingFramesAreCounted) {
  BracketAssembler a;
  feed(a, focus(1, 0, 5));
  EXPECT_EQ(feed(a, focus(1, 3, 5)), "3");
  EXPECT_EQ(last_step.missing, 2);
  EXPECT_TRUE(a.endsBefore(focus(2, 1, 5)));
  EXPECT_EQ(a.close(), 3);                   // the last one too
  EXPECT_EQ(feed(a, focus(2, 1, 5)), "(1");  // its first frame was lost
  EXPECT_EQ(last_step.missing, 1);
}

TEST(BracketAssembler, WhoStartsInMidBracketGetsTheNextOne) {
  BracketAssembler a;
  EXPECT_EQ(feed(a, focus(4, 2, 5)), "x");
  EXPECT_EQ(feed(a, focus(4, 3, 5)), "x");
  EXPECT_EQ(feed(a, focus(5, 0, 5)), "(0");
  a.restart();
  EXPECT_EQ(feed(a, focus(5, 1, 5)), "x");
}

TEST(BracketAssembler, TheSameIdFromTheBeginningIsANewBracket) {
  BracketAssembler a;
  feed(a, focus(0, 0));
  feed(a, focus(0, 1));
  EXPECT_EQ(feed(a, focus(0, 0)), ")(0");
  EXPECT_EQ(feed(a, focus(0, 0)), ")(0");
}

TEST(BracketAssembler, FramesThatComeTwiceAreRefused) {
  BracketAssembler a;
  feed(a, focus(0, 0));
  feed(a, focus(0, 1));
  EXPECT_EQ(feed(a, focus(0, 1)), "x");
  EXPECT_EQ(feed(a, focus(0, 70000)), "x");
  EXPECT_EQ(feed(a, focus(0, 2)), "2");
}

TEST(BracketAssembler, BracketBySize) {
  BracketAssembler a({2, 0});
  EXPECT_EQ(feed(a, at(0)), "(0");
  EXPECT_EQ(feed(a, at(100)), "1]");
  EXPECT_EQ(feed(a, at(101)), "(0");
  EXPECT_EQ(last_step.frame.bracket_id, 1u);
}

TEST(BracketAssembler, BracketByGap) {
  BracketAssembler a({0, 1.0});
  EXPECT_EQ(feed(a, at(0)), "(0");
  EXPECT_EQ(feed(a, at(0.9)), "1");
  EXPECT_FALSE(a.endsAfter(0.9));
  EXPECT_TRUE(a.endsAfter(1.1));
  EXPECT_EQ(feed(a, at(2.5)), ")(0");
  EXPECT_EQ(feed(a, at(1.6)), "1");
  EXPECT_EQ(feed(a, at(0.5)), ")(0");
}

TEST(BracketAssembler, ACountBeyondAllReasonIsLimited) {
  BracketAssembler a;
  feed(a, focus(0, 0, 0x7fffffff));
  EXPECT_EQ(last_step.frame.count, 65535u);
}

TEST(BracketAssembler, AFocusBracketAfterPlainFramesBeginsAtItsBeginning) {
  BracketAssembler a;
  feed(a, at(0));
  EXPECT_EQ(feed(a, focus(3, 4)), "x");
  EXPECT_EQ(feed(a, focus(3, 5)), "x");
  EXPECT_EQ(feed(a, focus(4, 0)), ")(0");
}

TEST(BracketAssembler, FocusMessagesThatAppearBeginABracket) {
  BracketAssembler a;
  feed(a, at(0));
  EXPECT_EQ(feed(a, focus(3, 0)), ")(0");
  EXPECT_FALSE(a.endsAfter(1000));  // a focus bracket takes its time
  EXPECT_TRUE(a.open() && a.byFocus());
  EXPECT_EQ(a.id(), 3u);
}

}  // namespace
