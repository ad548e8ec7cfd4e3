// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "output_files.hpp"

#include <unistd.h>

#include <array>
#include <atomic>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "file_error.hpp"
#include "image_files.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

constexpr std::array<int, 3> kSignals{SIGINT, SIGTERM, SIGHUP};
constexpr std::size_t kMostFiles = 64;  // a tool writes ten at most

// For the signal handler, which may neither lock nor allocate. The names are never freed.
std::array<std::atomic<const char*>, kMostFiles> g_temporaries{};
std::atomic<std::size_t> g_count{0};
std::atomic<bool> g_committing{false};
std::atomic<int> g_waiting_signal{0};

void endBy(int signal) {
  std::signal(signal, SIG_DFL);
  raise(signal);
}

void onSignal(int signal) {
  if (g_committing) {
    g_waiting_signal = signal;
    return;
  }
  for (std::size_t i = 0; i < g_count; ++i) unlink(g_temporaries[i]);
  endBy(signal);
}

/// While it exists, signals wait.
class Committing {
 public:
  Committing() { g_committing = true; }
  ~Committing() {
    g_committing = false;
    if (g_waiting_signal) onSignal(g_waiting_signal);
  }
  Committing(const Committing&) = delete;
  Committing& operator=(const Committing&) = delete;
};

/// Gives what is at `path` a second name; a file system without hard links gives it another one.
void keep(const fs::path& path, const fs::path& previous) {
  std::error_code error;
  fs::create_hard_link(path, previous, error);
  if (error) fs::rename(path, previous);
}

}  // namespace

OutputFiles::OutputFiles() {
  g_count = 0;
  for (const int signal : kSignals) {
    if (std::signal(signal, onSignal) == SIG_IGN) std::signal(signal, SIG_IGN);  // nohup
  }
}

OutputFiles::~OutputFiles() {
  std::error_code ignored;
  for (const File& file : files_) fs::remove(file.temporary, ignored);
  for (const int signal : kSignals) {
    if (std::signal(signal, SIG_DFL) == SIG_IGN) std::signal(signal, SIG_IGN);
  }
}

void OutputFiles::addImage(const std::string& path, const cv::Mat& image) {
  requireFree(path);
  write(path, encodeImage(path, image));
}

void OutputFiles::addText(const std::string& path, const std::string& text) {
  requireFree(path);
  write(path, text);
}

// Throws if no file can be written there.
void OutputFiles::requireFree(const std::string& path) const {
  const fs::path target(path);
  if (target.filename().empty() || fs::is_directory(target)) fail(path, "is a folder, not a file to write");
  if (target.has_parent_path() && !fs::is_directory(target.parent_path())) {
    fail(path, "the folder " + target.parent_path().string() + " does not exist");
  }
  for (const File& file : files_) {
    if (fs::weakly_canonical(file.path) == fs::weakly_canonical(target)) {
      fail(path, "two outputs are to go into this file");
    }
  }
  if (g_count == kMostFiles) fail(path, "too many outputs");
}

void OutputFiles::write(const std::string& path, const std::string& data) {
  const fs::path target(path);
  const std::string hidden = "." + target.filename().string() + "." + std::to_string(getpid());
  files_.push_back({path, (target.parent_path() / hidden).string(), {}});
  g_temporaries[g_count] = strdup(files_.back().temporary.c_str());
  ++g_count;
  std::ofstream file(files_.back().temporary, std::ios::binary);
  file << data;
  file.close();  // a full disk may show only here
  if (!file) fail(path, "cannot be written");
}

void OutputFiles::commit() {
  const Committing signals_wait;
  std::size_t renamed = 0;
  try {
    for (File& file : files_) {
      if (fs::is_directory(file.path)) fail(file.path, "is a folder, not a file to write");
      if (fs::exists(fs::symlink_status(file.path))) {
        file.previous = file.temporary + ".previous";
        keep(file.path, file.previous);
      }
      fs::rename(file.temporary, file.path);
      ++renamed;
    }
  } catch (const std::exception& e) {
    const auto* system = dynamic_cast<const fs::filesystem_error*>(&e);
    std::error_code ignored;
    for (std::size_t i = 0; i < files_.size(); ++i) {
      const File& file = files_[i];
      if (file.previous.empty()) {
        if (i < renamed) fs::remove(file.path, ignored);
        continue;
      }
      fs::rename(file.previous, file.path, ignored);
      // Two names of one file stay as they are.
      if (fs::equivalent(file.previous, file.path, ignored)) fs::remove(file.previous, ignored);
    }
    if (system) fail(files_[renamed].path, "cannot be written: " + system->code().message());
    throw;
  }
  std::error_code ignored;
  for (const File& file : files_) {
    if (!file.previous.empty()) fs::remove(file.previous, ignored);
  }
  files_.clear();
}

}  // namespace all_in_focus
