// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "quiet_stderr.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <mutex>

namespace all_in_focus {
namespace {

std::mutex mutex;
int alive = 0;
int loud = -1;  // stderr, as long as a QuietStderr lives

}  // namespace

QuietStderr::QuietStderr() {
  const std::lock_guard<std::mutex> lock(mutex);
  if (alive++ > 0) return;
  loud = dup(STDERR_FILENO);
  const int nowhere = open("/dev/null", O_WRONLY);
  if (loud >= 0 && nowhere >= 0) dup2(nowhere, STDERR_FILENO);
  if (nowhere >= 0) close(nowhere);
}

QuietStderr::~QuietStderr() {
  const std::lock_guard<std::mutex> lock(mutex);
  if (--alive > 0 || loud < 0) return;
  dup2(loud, STDERR_FILENO);
  close(loud);
  loud = -1;
}

void printToStderr(std::string line) {
  std::replace_if(
      line.begin(), line.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, ' ');
  writeToStderr(line + "\n");
}

void writeToStderr(const std::string& text) {
  const std::lock_guard<std::mutex> lock(mutex);
  dprintf(loud >= 0 ? loud : STDERR_FILENO, "%s", text.c_str());
}

}  // namespace all_in_focus
