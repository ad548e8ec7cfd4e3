// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "quiet_stderr.hpp"

namespace all_in_focus {
namespace {

constexpr double kTerminalPeriod = 0.1, kLinePeriod = 10;  // s
constexpr double kSoonest = 1;                             // s after which an estimate is worth something
constexpr std::size_t kTerminalWidth = 79;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string timeText(double seconds) {
  const auto whole = static_cast<long>(std::ceil(seconds));
  return whole < 100 ? std::to_string(whole) + " s" : std::to_string((whole + 30) / 60) + " min";
}

}  // namespace

Progress::Progress(std::string line_begin)
    : Progress(std::move(line_begin), isatty(STDERR_FILENO) != 0, writeToStderr, now) {}

Progress::Progress(std::string line_begin, bool terminal, std::function<void(const std::string&)> write,
                   std::function<double()> clock)
    : line_begin_(std::move(line_begin)),
      terminal_(terminal),
      write_(std::move(write)),
      clock_(std::move(clock)) {
  begin();
}

void Progress::begin() {
  begun_ = told_ = clock_();
}

void Progress::tell(const std::string& what, double share) {
  const double time = clock_();
  if (time - told_ < (terminal_ ? kTerminalPeriod : kLinePeriod)) return;
  told_ = time;
  std::string line = line_begin_ + what;
  if (share > 0 && time - begun_ >= kSoonest)
    line += ", " + timeText((time - begun_) * (1 - share) / share) + " left";
  if (terminal_) line = "\r" + line.substr(0, kTerminalWidth) + "\033[K";
  write_(terminal_ ? line : line + "\n");
  shown_ = terminal_;
}

void Progress::end() {
  if (std::exchange(shown_, false)) write_("\r\033[K");
}

ToldFrames::ToldFrames(core::FrameSource& frames, Progress& progress, int length, bool twice)
    : frames_(frames),
      progress_(progress),
      length_(length),
      extra_(twice ? length / 2 + 1 : 0),
      aligning_(twice) {}

bool ToldFrames::next(cv::Mat& frame) {
  if (!frames_.next(frame)) return false;
  ++read_, ++at_;
  std::string what = (aligning_ ? "aligning frame " : "fusing frame ") + std::to_string(at_);
  if (length_ > 0) what += " of " + std::to_string(length_);
  progress_.tell(what, length_ > 0 ? std::min(1.0, (read_ - 1) / (length_ + extra_)) : 0);
  return true;
}

void ToldFrames::rewind() {
  frames_.rewind();
  if (aligning_) extra_ = at_;
  aligning_ = false;
  at_ = 0;
}

}  // namespace all_in_focus
