// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "output_files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "file_error.hpp"
#include "stack_files.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

constexpr std::array<int, 3> kSignals{SIGINT, SIGTERM, SIGHUP};
constexpr std::size_t kMostFiles = 1 << 17;  // as many as a bracket may have frames, and as many marks

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
  removeTemporaryFiles();
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

/// What an output goes into: the end of the chain of links, whether a file is there or not.
fs::path target(const std::string& path) {
  constexpr int kMostLinks = 40;  // as Linux
  fs::path place(path);
  std::error_code error;
  for (int i = 0; i < kMostLinks && fs::is_symlink(fs::symlink_status(place, error)); ++i) {
    place = place.parent_path() / fs::read_symlink(place, error);  // an absolute link replaces the folder
    if (error) fail(path, "the link cannot be followed: " + error.message());
  }
  return place;
}

bool isStream(const fs::path& place) {
  std::error_code error;
  const fs::file_status status = fs::status(place, error);
  return fs::is_character_file(status) || fs::is_fifo(status);
}

// A standard stream of this process that is open on the file, such as /dev/stdout; -1 if there is none.
int standardStream(const std::string& path) {
  struct stat file {};
  if (stat(path.c_str(), &file) != 0) return -1;
  for (const int stream : {STDOUT_FILENO, STDERR_FILENO}) {
    struct stat open {};
    if (fstat(stream, &open) == 0 && open.st_dev == file.st_dev && open.st_ino == file.st_ino) return stream;
  }
  return -1;
}

// Throws where nothing can be written.
void requireWritable(const std::string& path) {
  const fs::path place = target(path);
  std::error_code error;
  const fs::file_status status = fs::status(place, error);
  if (place.filename().empty() || fs::is_directory(status)) fail(path, "is a folder, not a file to write");
  if (place.has_parent_path() && !fs::is_directory(place.parent_path())) {
    fail(path, "the folder " + place.parent_path().string() + " does not exist");
  }
  if (!fs::exists(status)) return;
  if (fs::is_block_file(status) || fs::is_socket(status))
    fail(path, "is a device or socket, not a file to write");
  constexpr fs::perms kWritable = fs::perms::owner_write | fs::perms::group_write | fs::perms::others_write;
  if ((status.permissions() & kWritable) == fs::perms::none)
    fail(path, "is write-protected: choose another name");
}

bool same(const fs::path& one, const fs::path& other) {
  std::error_code error;
  return fs::equivalent(one, other, error) && !error;
}

// Whether a file that exists would be read as a part of the folder.
bool isReadFrom(const fs::path& folder, const fs::path& file) {
  const std::string kind = ending(file.string());
  if (!isPictureName(file.string()) && kind != ".yaml" && kind != ".yml") return false;
  if (readPhotoMetadata(file.string()).is_result) return false;
  std::error_code error;
  for (fs::path above = fs::canonical(file, error).parent_path(); !error && above != above.parent_path();
       above = above.parent_path()) {
    if (same(above, folder)) return true;
  }
  const fs::directory_iterator entries(folder, error);
  return std::any_of(begin(entries), end(entries),
                     [&](const auto& entry) { return same(entry.path(), file); });
}

/// Gives what is at `path` a second name; a file system without hard links gives it another one.
void keep(const fs::path& path, const fs::path& previous) {
  std::error_code error;
  fs::create_hard_link(path, previous, error);
  if (error) fs::rename(path, previous);
}

}  // namespace

void removeTemporaryFiles() {
  for (std::size_t i = 0; i < g_count; ++i) unlink(g_temporaries[i]);
}

void requireSeparate(const std::vector<NamedPath>& inputs, const std::vector<NamedPath>& outputs) {
  for (const NamedPath& output : outputs) requireWritable(output.path);
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const auto& [option, path] = outputs[i];
    const fs::path place = target(path);
    for (const NamedPath& input : inputs) {
      std::error_code error;
      const bool is_read =
          same(place, input.path) || (fs::is_regular_file(place, error) &&
                                      fs::is_directory(input.path, error) && isReadFrom(input.path, place));
      if (is_read)
        fail(path, "--" + option + " would replace what --" + input.option + " reads: choose another name");
    }
    for (std::size_t j = 0; j < i; ++j) {
      const fs::path other = target(outputs[j].path);
      const bool have_one_name = place.filename() == other.filename() &&
                                 same(fs::absolute(place).parent_path(), fs::absolute(other).parent_path());
      if (same(place, other) || have_one_name) {
        fail(path, "--" + outputs[j].option + " and --" + option + " are two outputs for this one file");
      }
    }
  }
}

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

void OutputFiles::addImage(const std::string& path, const cv::Mat& image, const PhotoSource& source,
                           int quality) {
  std::string data =
      encodeImage(isStream(path) && ending(path).empty() ? path + ".png" : path, image, quality);
  const bool marked = markAsResult(data, source);
  add(path, data);
  if (!marked && !isStream(path)) {
    add(markBeside(path),
        "A program of all_in_focus wrote the picture beside this file. This file says so: it keeps the "
        "picture from being taken for a frame.\n");
  }
}

void OutputFiles::addText(const std::string& path, const std::string& text) {
  add(path, text);
}

void OutputFiles::add(const std::string& path, const std::string& data) {
  requireWritable(path);
  if (isStream(path) || standardStream(path) >= 0) {
    streams_.push_back({path, data});
    return;
  }
  if (g_count == kMostFiles) fail(path, "too many outputs");
  const fs::path place = target(path);
  drop(path);
  const std::string hidden = "." + place.filename().string() + "." + std::to_string(getpid());
  files_.push_back({place.string(), (place.parent_path() / hidden).string(), {}});
  const auto known = [&](const auto& name) { return files_.back().temporary == name.load(); };
  if (std::none_of(g_temporaries.begin(), g_temporaries.begin() + g_count, known)) {
    g_temporaries[g_count] = strdup(files_.back().temporary.c_str());
    ++g_count;
  }
  errno = 0;
  std::ofstream file(files_.back().temporary, std::ios::binary);
  file << data;
  file.close();  // a full disk may show only here
  if (!file) fail(path, "cannot be written: " + std::generic_category().message(errno));
  std::error_code ignored;
  const fs::file_status before = fs::status(place, ignored);
  if (fs::exists(before)) fs::permissions(files_.back().temporary, before.permissions(), ignored);
}

void OutputFiles::drop(const std::string& path) {
  const std::string place = target(path).string();
  const auto found =
      std::find_if(files_.begin(), files_.end(), [&](const File& file) { return file.path == place; });
  if (found == files_.end()) return;
  std::error_code ignored;
  fs::remove(found->temporary, ignored);
  files_.erase(found);
}

// Writes what goes into no regular file. Opening a FIFO waits for its reader.
void OutputFiles::writeStreams() const {
  for (const Stream& stream : streams_) {
    const int standard = standardStream(stream.path);
    const int file =
        standard >= 0 ? dup(standard) : open(stream.path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
    bool good = file >= 0;
    for (std::size_t done = 0; good && done < stream.data.size();) {
      const ssize_t written = ::write(file, stream.data.data() + done, stream.data.size() - done);
      good = written >= 0 || errno == EINTR;
      if (written > 0) done += static_cast<std::size_t>(written);
    }
    const std::string why = std::generic_category().message(errno);
    if (file >= 0) close(file);
    if (!good) fail(stream.path, "cannot be written: " + why);
  }
}

void OutputFiles::commit() {
  writeStreams();
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
