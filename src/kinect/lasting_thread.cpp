// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "lasting_thread.hpp"

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace all_in_focus {
namespace {

struct Pool {
  std::mutex mutex;  // guards all below
  std::condition_variable changed;
  std::deque<std::packaged_task<void()>> tasks;
  std::size_t idle = 0;  // threads
};

void serve(Pool& pool) {
  for (;;) {
    std::packaged_task<void()> task;
    {
      std::unique_lock<std::mutex> lock(pool.mutex);
      ++pool.idle;
      pool.changed.wait(lock, [&] { return !pool.tasks.empty(); });
      --pool.idle;
      task = std::move(pool.tasks.front());
      pool.tasks.pop_front();
    }
    task();
  }
}

}  // namespace

std::future<void> runInLastingThread(std::function<void()> function) {
  static Pool& pool = *new Pool;  // lives as long as its threads
  std::lock_guard<std::mutex> lock(pool.mutex);
  pool.tasks.emplace_back(std::move(function));
  if (pool.idle < pool.tasks.size()) std::thread([] { serve(pool); }).detach();
  pool.changed.notify_one();
  return pool.tasks.back().get_future();
}

}  // namespace all_in_focus
