// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>

#include "all_in_focus/pipeline.hpp"

namespace all_in_focus {

/// Tells on stderr how far a long piece of work is, and how long it will still take: on a terminal in one
/// line that is written over and removed in the end, else in a line every ten seconds.
class Progress {
 public:
  /// line_begin: what each line begins with.
  explicit Progress(std::string line_begin);
  /// The same with a terminal or none, a place to write to, and a clock that gives seconds.
  Progress(std::string line_begin, bool terminal, std::function<void(const std::string&)> write,
           std::function<double()> clock);
  ~Progress() { end(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Begins a piece of work.
  void begin();
  /// what: is being done; share: of the work that is done, 0..1, 0 = unknown.
  void tell(const std::string& what, double share);
  /// Removes the line.
  void end();

 private:
  std::string line_begin_;
  bool terminal_, shown_ = false;
  std::function<void(const std::string&)> write_;
  std::function<double()> clock_;
  double begun_ = 0, told_ = 0;  // s
};

/// Passes frames on and tells which one is read.
class ToldFrames : public core::FrameSource {
 public:
  /// length: of the bracket, 0 = unknown; twice: frames before the reference are read twice.
  ToldFrames(core::FrameSource& frames, Progress& progress, int length, bool twice);

  bool next(cv::Mat& frame) override;
  void rewind() override;
  int count() override { return frames_.count(); }

 private:
  core::FrameSource& frames_;
  Progress& progress_;
  const int length_;
  double extra_;  // frames that are read a second time
  int read_ = 0, at_ = 0;
  bool aligning_;
};

}  // namespace all_in_focus
