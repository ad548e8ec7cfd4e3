// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "batch_fusion.hpp"

#include <algorithm>
#include <boost/any.hpp>
#include <exception>
#include <filesystem>
#include <iostream>
#include <map>
#include <opencv2/core.hpp>
#include <sstream>
#include <stdexcept>

#include "command_line.hpp"
#include "file_error.hpp"
#include "image_files.hpp"
#include "output_files.hpp"
#include "photo_metadata.hpp"
#include "quiet_stderr.hpp"
#include "result_files.hpp"
#include "stack_files.hpp"

namespace fs = std::filesystem;
namespace po = boost::program_options;

namespace all_in_focus {
namespace {

// Options that name what belongs to one scene.
constexpr const char* kOfOneScene[] = {"depth", "registered-depth", "label-map", "focus"};

// The outputs that the user has named.
std::vector<NamedPath> outputsOf(const po::variables_map& values, std::vector<const char*> options) {
  options.push_back("save-aligned");
  std::vector<NamedPath> outputs;
  for (const char* option : options) {
    if (values.count(option)) outputs.push_back({option, values[option].as<std::string>()});
  }
  return outputs;
}

// The options for one stack: outputs lie in the folders that the user has named, under its name.
po::variables_map valuesFor(const NamedStack& stack, const po::variables_map& values,
                            const std::vector<const char*>& writes) {
  static const std::map<std::string, std::string> kEndings = {
      {"report", ".json"}, {"save-cloud", ".ply"}, {"save-aligned", ""}};
  po::variables_map own = values;
  for (const NamedPath& output : outputsOf(values, writes)) {
    const auto ending = kEndings.find(output.option);
    const std::string name = stack.name + (ending == kEndings.end() ? ".png" : ending->second);
    static_cast<std::map<std::string, po::variable_value>&>(own)[output.option] =
        po::variable_value(boost::any((fs::path(output.path) / name).string()), /*defaulted=*/false);
  }
  return own;
}

// Of the regular files in a folder.
bool areOlder(const std::string& folder, fs::file_time_type time) {
  std::error_code error;  // what cannot be read is told when it is used
  const fs::directory_iterator files(folder, error);
  return std::all_of(begin(files), end(files), [&](const fs::directory_entry& file) {
    return !file.is_regular_file(error) || file.last_write_time(error) <= time;
  });
}

// Whether an earlier run has fused the stack: the outputs are there, of the same frames and options, and
// younger than frames and rig. Throws where the picture there is not ours to replace.
bool isFused(const NamedStack& stack, const po::variables_map& values,
             const std::vector<const char*>& writes) {
  const auto output = values["output"].as<std::string>();
  const PhotoMetadata former = readPhotoMetadata(output);
  if (fs::exists(output) && !former.is_result)
    fail(output, "is there, and no result of this package: name another folder");
  for (const NamedPath& written : outputsOf(values, writes)) {
    if (!former.is_result && written.option != "save-aligned" && fs::exists(written.path))
      fail(written.path, "is there without a result of this package beside it: name another folder");
  }
  if (former.options != optionsText(values)) return false;
  fs::file_time_type oldest = fs::file_time_type::max();
  for (const NamedPath& written : outputsOf(values, writes)) {
    if (!fs::exists(written.path)) return false;
    oldest = std::min(oldest, fs::last_write_time(written.path));
  }
  if (values.count("rig") && !areOlder(values["rig"].as<std::string>(), oldest)) return false;
  if (!fs::is_directory(stack.path))
    return fs::exists(stack.path) && fs::last_write_time(stack.path) <= oldest;
  const StackFiles files = listStack(stack.path, stack.files);
  const auto is_older = [&](const StackFiles::Source& source) {
    return fs::last_write_time(source.path) <= oldest;
  };
  return former.frames == namesText(files.frames) &&
         std::all_of(files.sources.begin(), files.sources.end(), is_older);
}

// Returns the folders that were not there.
std::vector<std::string> makeFolders(const po::variables_map& values,
                                     const std::vector<const char*>& writes) {
  std::vector<std::string> made;
  for (const auto& [option, folder] : outputsOf(values, writes)) {
    const std::string kind = ending(folder);
    if (isPictureName(folder) || kind == ".json" || kind == ".ply")
      fail(folder, "--" + option + " names a folder, not a file, where stacks are several");
    std::error_code error;
    if (fs::create_directories(folder, error)) made.push_back(folder);
    if (!fs::is_directory(folder)) fail(folder, "no such folder, and it cannot be made");
  }
  return made;
}

}  // namespace

void fuseStacks(const po::variables_map& values, const std::vector<NamedStack>& stacks,
                const std::vector<const char*>& writes, const FuseStack& fuse) {
  for (const char* option : kOfOneScene) {
    if (values.count(option))
      throw std::invalid_argument(std::string("--") + option + " belongs to one scene: fuse its stack alone");
  }
  const std::vector<std::string> made = makeFolders(values, writes);
  std::size_t width = 5, there = 0, failed = 0;
  for (const NamedStack& stack : stacks) width = std::max(width, stack.name.size());
  std::ostringstream table;
  const auto row = [&](const std::string& name, const std::string& frames, const std::string& result) {
    table << name << std::string(width + 2 - name.size(), ' ') << frames
          << std::string(std::max<std::size_t>(12, frames.size() + 1) - frames.size(), ' ') << result << '\n';
  };
  row("stack", "frames", "result");
  for (std::size_t i = 0; i < stacks.size(); ++i) {
    const NamedStack& stack = stacks[i];
    const std::string who = "fuse_stack: " + stack.name + ": ";
    const std::string ahead = cv::format("%zu of %zu, ", i + 1, stacks.size()) + stack.name + ": ";
    try {
      const po::variables_map own = valuesFor(stack, values, writes);
      const std::string output = own["output"].as<std::string>();
      if (isFused(stack, own, writes)) {
        row(stack.name, "", output + ", there already");
        ++there;
        continue;
      }
      const Fused fused = fuse(own, stack, who, ahead);
      row(stack.name, cv::format("%d of %d", fused.used, fused.length), output);
    } catch (const std::exception&) {
      const std::string why = describe(std::current_exception());
      printToStderr(who + why);
      row(stack.name, "", "failed: " + why);
      ++failed;
    }
  }
  std::cout << table.str()
            << cv::format("%zu stacks: %zu fused, %zu there already, %zu failed", stacks.size(),
                          stacks.size() - there - failed, there, failed)
            << std::endl;
  std::error_code not_empty;
  for (const std::string& folder : made) fs::remove(folder, not_empty);
  if (failed > 0) throw std::invalid_argument(cv::format("%zu of %zu stacks failed", failed, stacks.size()));
}

}  // namespace all_in_focus
