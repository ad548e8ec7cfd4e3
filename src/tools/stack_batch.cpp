// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "stack_batch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>

#include "file_error.hpp"
#include "image_files.hpp"
#include "natural_order.hpp"
#include "photo_metadata.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

constexpr double kLongStep = 3;     // times the usual time between two exposures
constexpr double kLeastGap = 2;     // s more than the usual time; EXIF often gives whole seconds
constexpr double kSameScene = 0.8;  // correlation of neighbours; frames far out of focus reach 0.9

// Whether pictures lie in the folder that may be frames.
bool holdsFrames(const fs::path& folder) {
  std::error_code error;
  const fs::directory_iterator entries(folder, error);
  return std::any_of(begin(entries), end(entries), [](const fs::directory_entry& entry) {
    const std::string name = entry.path().filename().string();
    std::error_code ignored;
    return name[0] != '.' && isPictureName(name) && !entry.is_directory(ignored) &&
           !readPhotoMetadata(entry.path().string()).is_result;
  });
}

std::vector<std::string> stacksIn(const std::string& path) {
  std::error_code error;
  if (!fs::is_directory(path, error) || holdsFrames(path)) return {};
  std::vector<std::string> found;
  for (const auto& entry : fs::directory_iterator(path, error)) {
    if (entry.path().filename().string()[0] != '.' && entry.is_directory(error) && holdsFrames(entry.path()))
      found.push_back(entry.path().string());
  }
  return inNaturalOrder(found);
}

// The whole path of a stack, without the ending of a file.
fs::path placeOf(const std::string& path) {
  std::error_code error;
  fs::path place = fs::weakly_canonical(path, error);
  if (!fs::is_directory(place, error)) place.replace_extension();
  return place;
}

// The last parts of a path, "photos/one": "photos_one".
std::string lastParts(fs::path place, std::size_t count) {
  std::string name;
  for (; count > 0 && place.has_relative_path(); --count, place = place.parent_path())
    name = place.filename().string() + (name.empty() ? "" : "_") + name;
  return name;
}

std::optional<double> secondsOf(const std::string& taken) {
  std::tm date{};
  double second = 0;
  const int read = std::sscanf(taken.c_str(), "%d:%d:%d %d:%d:%lf", &date.tm_year, &date.tm_mon,
                               &date.tm_mday, &date.tm_hour, &date.tm_min, &second);
  if (read != 6) return std::nullopt;
  date.tm_year -= 1900, --date.tm_mon;
  return static_cast<double>(timegm(&date)) + second;
}

// Times between the exposures, s; empty where one is unknown.
std::vector<double> steps(const std::vector<StackFiles::Source>& sources) {
  std::vector<double> found;
  std::optional<double> before;
  for (const StackFiles::Source& source : sources) {
    const std::optional<double> time = secondsOf(readPhotoMetadata(source.path).taken);
    if (!time) return {};
    if (before) found.push_back(std::abs(*time - *before));
    before = time;
  }
  return found;
}

cv::Mat thumbnail(const StackFiles::Source& source) {
  cv::Mat gray;
  cv::cvtColor(readHalfColor(source.path, source.page), gray, cv::COLOR_BGR2GRAY);
  const int height = std::max(8, 64 * gray.rows / gray.cols);
  cv::resize(gray, gray, {64, height}, 0, 0, cv::INTER_AREA);
  cv::GaussianBlur(gray, gray, {}, 2);  // what focus does not change
  return gray;
}

double correlation(const cv::Mat& one, const cv::Mat& other) {
  if (one.size() != other.size()) return 0;
  cv::Scalar mean_one, mean_other, sigma_one, sigma_other;
  cv::meanStdDev(one, mean_one, sigma_one);
  cv::meanStdDev(other, mean_other, sigma_other);
  const double deviations = sigma_one[0] * sigma_other[0];
  if (deviations == 0) return mean_one == mean_other ? 1 : 0;
  return (one.dot(other) / static_cast<double>(one.total()) - mean_one[0] * mean_other[0]) / deviations;
}

// The frames that a bracket begins with, but the first of all.
std::set<std::size_t> gapsInTime(const std::vector<double>& steps) {
  std::set<std::size_t> begins;
  if (steps.empty()) return begins;
  std::vector<double> sorted = steps;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const double usual = sorted[sorted.size() / 2];
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] > std::max(kLongStep * usual, usual + kLeastGap)) begins.insert(i + 1);
  }
  return begins;
}

std::set<std::size_t> changesOfScene(const std::vector<StackFiles::Source>& sources) {
  std::set<std::size_t> begins;
  cv::Mat before;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    const cv::Mat picture = thumbnail(sources[i]);
    if (!before.empty() && correlation(before, picture) < kSameScene) begins.insert(i);
    before = picture;
  }
  return begins;
}

std::set<std::size_t> beginsOf(const NamedStack& stack, const std::vector<StackFiles::Source>& sources,
                               const std::string& rule) {
  std::set<std::size_t> begins;
  if (rule == "gap") {
    const std::vector<double> times = steps(sources);
    begins = times.empty() ? changesOfScene(sources) : gapsInTime(times);
    if (begins.empty()) {
      fail(stack.path, times.empty()
                           ? "--split gap: no EXIF times, and all pictures show the same: say --split N"
                           : "--split gap: no exposure came long after the one before: say --split N");
    }
    return begins;
  }
  const bool is_number =
      !rule.empty() && rule.size() < 6 && rule.find_first_not_of("0123456789") == std::string::npos;
  const std::size_t size = is_number ? std::stoul(rule) : 0;
  if (size == 0) throw std::invalid_argument("--split: '" + rule + "' is neither a number of frames nor gap");
  for (std::size_t i = size; i < sources.size(); i += size) begins.insert(i);
  return begins;
}

}  // namespace

bool holdsStacks(const std::string& path) {
  return !stacksIn(path).empty();
}

std::vector<NamedStack> findStacks(const std::vector<std::string>& paths) {
  std::vector<NamedStack> stacks;
  for (const std::string& path : paths) {
    const std::vector<std::string> inside = stacksIn(path);
    for (const std::string& stack : inside) stacks.push_back({stack, "", {}});
    if (inside.empty()) stacks.push_back({path, "", {}});
  }
  std::vector<fs::path> places;
  places.reserve(stacks.size());
  for (const NamedStack& stack : stacks) places.push_back(placeOf(stack.path));
  // By so many parts of the path that no two are alike.
  for (std::size_t i = 0; i < stacks.size(); ++i) {
    const auto is_alone = [&](const std::string& name, std::size_t parts) {
      return std::count_if(places.begin(), places.end(),
                           [&](const fs::path& other) { return lastParts(other, parts) == name; }) == 1;
    };
    std::size_t parts = 1;
    std::string& name = stacks[i].name = lastParts(places[i], parts);
    while (!is_alone(name, parts)) {
      const std::string longer = lastParts(places[i], ++parts);
      if (longer == name) break;
      name = longer;
    }
  }
  return stacks;
}

std::vector<NamedStack> splitStack(const NamedStack& stack, const std::string& rule) {
  if (!holdsPictures(stack.path)) fail(stack.path, "--split needs a folder of pictures");
  const StackFiles files = listStack(stack.path);
  const std::vector<std::string>& names = files.frames;
  const std::set<std::size_t> begins = beginsOf(stack, files.sources, rule);
  std::vector<NamedStack> parts;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (i == 0 || begins.count(i) != 0) parts.push_back({stack.path, "", {}});
    parts.back().files.insert(names[i]);
  }
  const std::size_t digits = std::max<std::size_t>(2, std::to_string(parts.size()).size());
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::string number = std::to_string(i + 1);
    parts[i].name = stack.name + "_" + std::string(digits - number.size(), '0') + number;
  }
  return parts;
}

}  // namespace all_in_focus
