// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
//
// Linked into the core when the thread sanitizer is. OpenCV's threads are TBB's, whose atomics it does not
// see, because the distribution's libraries are not compiled with it: every loop would look like a race. By
// std::thread it sees what the strips of a loop do to each other and to what comes before and after.

#include <algorithm>
#include <atomic>
#include <memory>
#include <opencv2/core/parallel/parallel_backend.hpp>
#include <thread>
#include <vector>

namespace {

thread_local int g_thread = 0;

class StandardThreads : public cv::parallel::ParallelForAPI {
 public:
  void parallel_for(int tasks, FN_parallel_for_body_cb_t body, void* data) override {
    const int shares = std::min(tasks, threads_.load());
    std::vector<std::thread> threads;
    for (int i = 0; i < shares; ++i)
      threads.emplace_back([=] {
        g_thread = i;
        body(tasks * i / shares, tasks * (i + 1) / shares, data);
      });
    for (std::thread& thread : threads) thread.join();
  }
  int getThreadNum() const override { return g_thread; }
  int getNumThreads() const override { return threads_; }
  int setNumThreads(int threads) override { return threads_.exchange(threads > 0 ? threads : kUsual); }
  const char* getName() const override { return "std::thread"; }

 private:
  static constexpr int kUsual = 3;
  std::atomic<int> threads_{kUsual};
};

const bool g_chosen = [] {
  cv::parallel::setParallelForBackend(std::make_shared<StandardThreads>());
  return true;
}();

}  // namespace
