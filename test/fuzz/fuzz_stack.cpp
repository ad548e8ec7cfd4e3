// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Folders with files of any names, as a stack.

#include <algorithm>
#include <filesystem>
#include <set>

#include "image_files.hpp"
#include "scratch_folder.hpp"
#include "stack_reader.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr int kMostFiles = 24;
constexpr std::size_t kLongestName = 40;

const std::string& picture() {
  static const std::string bytes = encodeImage("x.png", cv::Mat(2, 3, CV_8UC3, cv::Scalar::all(9)));
  return bytes;
}

using Files = std::vector<std::pair<std::string, std::string>>;  // names and contents

Files filesFrom(Input& input) {
  Files files;
  std::set<std::string> names;
  for (int i = input.below(kMostFiles); i > 0; --i) {
    const std::string name = input.text(kLongestName);
    const bool is_name = !name.empty() && name != "." && name != ".." &&
                         name.find_first_of(std::string("/\0", 2)) == std::string::npos;
    const std::string bytes = input.flag() ? input.text() : picture();
    if (is_name && names.insert(name).second) files.emplace_back(name, bytes);
  }
  return files;
}

void requireListed(const StackReader& stack, const Files& files) {
  std::set<std::string> listed;
  for (const auto* names : {&stack.names(), &stack.leftOut()}) {
    for (const std::string& name : *names) {
      const bool exists =
          std::any_of(files.begin(), files.end(), [&](const auto& it) { return it.first == name; });
      require(exists, "a name that no file has");
      require(listed.insert(name).second, "a file twice");
      require(name[0] != '.', "a hidden file");
    }
  }
}

void run(Input& input) {
  const ScratchFolder folder, other;
  Files files = filesFrom(input);
  for (const auto& [name, bytes] : files) folder.write(name, bytes);
  std::unique_ptr<StackReader> stack;
  if (!accepts([&] { stack = std::make_unique<StackReader>(folder.path()); })) return;
  requireListed(*stack, files);
  require(stack->count() == static_cast<int>(stack->names().size()), "another number of frames");
  // File systems list files in any order.
  for (auto it = files.rbegin(); it != files.rend(); ++it) other.write(it->first, it->second);
  require(StackReader(other.path()).names() == stack->names(), "the order depends on the file system");

  stack->glance();
  cv::Mat frame;
  int count = 0;
  const bool are_whole = accepts([&] {
    while (stack->next(frame)) ++count;
  });
  require(!are_whole || count == stack->count(), "not all frames");
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  std::vector<std::vector<std::string>> folders = {
      {"00.png", "01.PNG", "notes.txt", ".hidden.png", "raw.nef", "x.heic"},
      {"2.jpg", "10.jpg", "a.jpeg"},
      {"x-5.png", "x+5.png", "x-10.png", "x0.png", "y-1.png"},
      {"IMG_9999.JPG", "IMG_0001.JPG", "x.tiff", "x.tif"},
      {".png", "png", "a.b.webp", "\xff\xc4.bmp", "99999999999999999999.ppm"}};
  std::vector<std::string> long_one;
  for (int i = 0; i < 20; ++i)
    long_one.push_back("a" + std::to_string(i * i % 23) + "-" + std::to_string(i) + ".png");
  folders.push_back(long_one);
  for (const auto& names : folders) {
    Seed seed;
    seed.below(static_cast<int>(names.size()));
    for (const std::string& name : names) seed.text(name).flag(false);
    seeds.push_back(seed);
  }
  return seeds;
}

const FuzzTarget target("stack", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
