// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <opencv2/core.hpp>
#include <stdexcept>

namespace all_in_focus::core {

/// A depth image of one page of memory: who reads before or behind it ends the program.
class GuardedDepth {
 public:
  explicit GuardedDepth(int mm) {
    memory_ = mmap(nullptr, 3 * page_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory_ == MAP_FAILED) throw std::runtime_error("no memory to guard");
    void* begin = static_cast<char*>(memory_) + page_;
    mprotect(begin, page_, PROT_READ | PROT_WRITE);
    const int cols = 64;
    depth = cv::Mat(static_cast<int>(page_) / 2 / cols, cols, CV_16UC1, begin);
    depth.setTo(mm);
  }
  GuardedDepth(const GuardedDepth&) = delete;
  GuardedDepth& operator=(const GuardedDepth&) = delete;
  ~GuardedDepth() { munmap(memory_, 3 * page_); }

  cv::Mat depth;  ///< CV_16UC1, 64 wide, mm

 private:
  std::size_t page_ = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  void* memory_;
};

}  // namespace all_in_focus::core
