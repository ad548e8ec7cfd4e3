// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "command_line.hpp"

#include <malloc.h>
#include <sys/mman.h>

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <limits>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <system_error>

#include "output_files.hpp"
#include "quiet_stderr.hpp"

namespace po = boost::program_options;

namespace all_in_focus {
namespace {

constexpr int kBadInput = 2;  // exit code
constexpr const char* kNoMemory = "memory is short: end other programs, or use smaller pictures";

// Freed memory stays with the process: the kernel clears every page that it hands out, which would take a
// tenth of restoration's time.
void keepFreedMemory() {
#ifdef __GLIBC__
  constexpr int kLargestMmapThreshold = 32 << 20;  // bytes; glibc admits no more
  mallopt(M_MMAP_THRESHOLD, kLargestMmapThreshold);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

std::string g_name;  // of the program

// For an exception that nobody can catch, such as one of a thread that a library has started.
[[noreturn]] void endAtOnce() {
  removeTemporaryFiles();
  printToStderr(g_name + ": " +
                (std::current_exception() ? describe(std::current_exception()) : "ended by itself"));
  std::_Exit(kBadInput);
}

// Throws std::bad_alloc. GDAL, which starts with OpenCV's first encoder or decoder, aborts or crashes where
// memory is short. So it starts before anything else takes memory, and only if there is more than the 30 MB
// that it needs.
void startCodecs() {
  constexpr std::size_t kBytes = std::size_t{64} << 20;
  void* const memory = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw std::bad_alloc();
  munmap(memory, kBytes);
  static_cast<void>(cv::haveImageWriter(".png"));
}

int parseAndRun(int argc, char** argv, const po::options_description& options, const Tool& tool) {
  keepFreedMemory();
  const std::string path = argv[0];
  g_name = path.substr(path.rfind('/') + 1);
  // The tool prints one line about what is wrong; the decoders' own messages would bury it.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", /*overwrite=*/0);
  std::signal(SIGPIPE, SIG_IGN);  // a reader that has gone is an error of writing
  std::set_terminate(endAtOnce);
  try {
    // An abbreviated option is an error, so that scripts do not break when options are added.
    const auto style = po::command_line_style::default_style & ~po::command_line_style::allow_guessing;
    po::variables_map values;
    po::positional_options_description positional;
    if (tool.positional) positional.add(tool.positional, -1);
    po::options_description all = options;
    all.add_options()("help,h", "this text")("version", "print the version of the package");
    po::store(po::command_line_parser(argc, argv).options(all).positional(positional).style(style).run(),
              values);
    if (values.count("help")) {
      std::cout << g_name << ": " << tool.purpose << "\n\n" << all;
      return 0;
    }
    if (values.count("version")) {
      std::cout << g_name << " of all_in_focus " << ALL_IN_FOCUS_VERSION << '\n';
      return 0;
    }
    po::notify(values);
    for (const auto& [option, value] : values) {
      const auto* text = boost::any_cast<std::string>(&value.value());
      const auto* texts = boost::any_cast<std::vector<std::string>>(&value.value());
      const bool is_flag = all.find(option, /*approx=*/false).semantic()->max_tokens() == 0;
      const bool is_empty =
          (text && text->empty()) || (texts && std::find(texts->begin(), texts->end(), "") != texts->end());
      if (is_empty && !is_flag) throw std::invalid_argument("--" + option + " is empty");
    }
    startCodecs();
    if (!tool.separates) requireSeparate(given(values, tool.reads), given(values, tool.writes));
    tool.run(values);
    return 0;
  } catch (...) {
    printToStderr(g_name + ": " + describe(std::current_exception()));
    return kBadInput;
  }
}

}  // namespace

std::string describe(const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    return kNoMemory;
  } catch (const std::system_error& e) {
    return e.code() == std::errc::resource_unavailable_try_again ? kNoMemory
                                                                 : e.what();  // no thread could start
  } catch (const cv::Exception& e) {
    return e.code == cv::Error::StsNoMem ? kNoMemory : e.what();
  } catch (const std::exception& e) {
    return e.what();
  } catch (...) {
    return "unknown error";
  }
}

void runTool(int argc, char** argv, const po::options_description& options, const Tool& tool) {
  const int code = parseAndRun(argc, argv, options, tool);
  std::cout.flush();
  // Libraries' own clean-up hangs where memory is short: OpenBLAS waits for threads that wait for memory.
  std::_Exit(code);
}

std::vector<NamedPath> given(const po::variables_map& values, const std::vector<const char*>& names) {
  std::vector<NamedPath> paths;
  for (const char* name : names) {
    if (!values.count(name)) continue;
    if (const auto* several = boost::any_cast<std::vector<std::string>>(&values[name].value())) {
      for (const std::string& path : *several) paths.push_back({name, path});
    } else {
      paths.push_back({name, values[name].as<std::string>()});
    }
  }
  return paths;
}

std::string textOption(const po::variables_map& values, const char* name) {
  return values.count(name) ? values[name].as<std::string>() : std::string();
}

}  // namespace all_in_focus
