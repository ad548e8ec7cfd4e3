// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <future>

namespace all_in_focus {

/// Runs a function in a thread that does not end with it, but serves the next call. The future is ready when
/// the function has returned.
///
/// OpenNI2 remembers each thread that has called it. When another thread calls, it asks pthread_kill()
/// whether those of before still live. From glibc 2.34 on that crashes if the memory of such a thread is
/// gone.
std::future<void> runInLastingThread(std::function<void()> function);

}  // namespace all_in_focus
