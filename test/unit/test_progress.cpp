// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <string>

#include "progress.hpp"

using namespace all_in_focus;

namespace {

struct Told {
  std::string text;
  double time = 100;
  Progress progress;

  explicit Told(bool terminal)
      : progress(
            "tool: ", terminal, [this](const std::string& more) { text += more; }, [this] { return time; }) {}

  void after(double seconds, const std::string& what, double share) {
    time += seconds;
    progress.tell(what, share);
  }
};

class TenFrames : public core::FrameSource {
 public:
  bool next(cv::Mat& /*frame*/) override { return at_++ < 10; }
  void rewind() override { at_ = 0; }
  int count() override { return 10; }

 private:
  int at_ = 0;
};

TEST(Progress, OneLineOnATerminal) {
  Told told(true);
  told.after(0.05, "frame 1", 0.1);  // too soon
  told.after(1.95, "frame 2", 0.2);
  told.after(0.05, "frame 3", 0.3);
  told.after(1.95, "frame 4", 0.4);
  told.progress.end();
  told.progress.end();
  EXPECT_EQ(told.text, "\rtool: frame 2, 8 s left\033[K\rtool: frame 4, 6 s left\033[K\r\033[K");
}

TEST(Progress, ALineNowAndThenElse) {
  Told told(false);
  told.after(9, "frame 1", 0.01);
  told.after(2, "frame 2", 0.02);
  told.after(5, "frame 3", 0.03);
  told.after(6, "frame 4", 0);
  told.progress.end();
  EXPECT_EQ(told.text, "tool: frame 2, 9 min left\ntool: frame 4\n");
}

TEST(Progress, AShortRunTellsNothing) {
  Told told(false);
  told.after(0.5, "frame 1", 0.9);
  told.progress.end();
  EXPECT_EQ(told.text, "");
}

TEST(Progress, FramesThatAreReadTwice) {
  Told told(true);
  TenFrames ten;
  ToldFrames frames(ten, told.progress, ten.count(), /*twice=*/true);
  cv::Mat frame;
  const auto read = [&](int number) {
    for (int i = 0; i < number; ++i) {
      told.time += 1;
      ASSERT_TRUE(frames.next(frame));
    }
  };
  read(6);  // up to the reference
  EXPECT_NE(told.text.rfind("\rtool: aligning frame 6 of 10, "), std::string::npos) << told.text;
  frames.rewind();
  read(10);
  EXPECT_NE(told.text.rfind("\rtool: fusing frame 10 of 10, 2 s left"), std::string::npos) << told.text;
  EXPECT_FALSE(frames.next(frame));
}

}  // namespace
