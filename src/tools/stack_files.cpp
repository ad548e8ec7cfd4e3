// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "stack_files.hpp"

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "file_error.hpp"
#include "image_files.hpp"
#include "natural_order.hpp"
#include "photo_metadata.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

const std::set<std::string> kReadable = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp",
                                         ".ppm", ".pgm", ".pnm",  ".jp2", ".webp"};
const std::set<std::string> kCameraRaw = {".nef", ".nrw", ".cr2", ".cr3", ".crw", ".arw", ".srw", ".dng",
                                          ".raf", ".orf", ".rw2", ".pef", ".raw", ".3fr", ".iiq", ".x3f"};
const std::set<std::string> kOther = {".heic", ".heif", ".avif", ".jxl", ".gif", ".exr", ".hdr", ".psd"};

struct Picture {
  std::string name;
  PhotoMetadata about;
  fs::file_time_type changed;
};

std::string listed(const std::vector<std::string>& names) {
  constexpr std::size_t kShown = 3;
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kShown); ++i) text += (i == 0 ? "" : ", ") + names[i];
  return names.size() > kShown ? text + " and " + std::to_string(names.size() - kShown) + " more" : text;
}

/// Sorts out the pictures of one folder.
class Listing {
 public:
  Listing(const std::string& folder, const std::set<std::string>& only) : folder_(folder), only_(only) {}

  StackFiles make() {
    collect();
    leaveOut("earlier results of this package", [](const Picture& it) { return it.about.is_result; });
    sort();
    leaveOutOtherSizes();
    leaveOutLaterOnes();
    if (pictures_.empty())
      fail(folder_, "the folder holds no image" + (files_.notes.empty() ? "" : ": " + files_.notes[0]));
    compareTimes();
    findOrientation();
    for (const Picture& picture : pictures_) files_.frames.push_back(picture.name);
    return files_;
  }

 private:
  void note(const std::string& text) { files_.notes.push_back(folder_ + ": " + text); }

  void collect() {
    std::vector<std::string> unreadable, raw, lost;
    std::error_code unreadable_folder, error;
    for (const auto& entry : fs::directory_iterator(folder_, unreadable_folder)) {
      const std::string name = entry.path().filename().string(), kind = ending(name);
      if (name[0] == '.' || entry.is_directory(error)) continue;
      if (!only_.empty() && only_.count(name) == 0) continue;
      if (kCameraRaw.count(kind) != 0) raw.push_back(name);
      if (kOther.count(kind) != 0) unreadable.push_back(name);
      if (kReadable.count(kind) == 0) continue;
      if (!entry.is_regular_file(error)) {
        lost.push_back(name);
        continue;
      }
      pictures_.push_back(
          {name, readPhotoMetadata(entry.path().string()), fs::last_write_time(entry.path(), error)});
    }
    if (unreadable_folder) fail(folder_, "cannot be read: " + unreadable_folder.message());
    tell(raw, "camera raw files cannot be read: develop them first");
    tell(unreadable, "pictures of this format cannot be read: convert them first, to PNG, TIFF or JPEG");
    tell(lost, "no file is there: a broken link, or no regular file");
  }

  void tell(std::vector<std::string> names, const std::string& why) {
    if (names.empty()) return;
    std::sort(names.begin(), names.end());
    note("left out " + listed(names) + ": " + why);
  }

  // Leaves out the pictures that belong to `kind`, unless all do.
  template <typename IsOf>
  void leaveOut(const std::string& kind, const IsOf& isOf) {
    std::vector<std::string> names;
    for (const Picture& picture : pictures_) {
      if (isOf(picture)) names.push_back(picture.name);
    }
    if (names.empty() || names.size() == pictures_.size()) return;
    pictures_.erase(std::remove_if(pictures_.begin(), pictures_.end(), isOf), pictures_.end());
    tell(names, kind);
    files_.left_out.insert(files_.left_out.end(), names.begin(), names.end());
  }

  void sort() {
    std::vector<std::string> names;
    for (const Picture& picture : pictures_) names.push_back(picture.name);
    const NaturalOrder order(names);
    std::sort(pictures_.begin(), pictures_.end(), [&order](const Picture& a, const Picture& b) {
      const int by_name = order.compare(a.name, b.name);
      if (by_name != 0) return by_name < 0;
      return a.about.taken != b.about.taken ? a.about.taken < b.about.taken : a.name < b.name;
    });
    for (std::size_t i = 0; i < pictures_.size(); ++i) names[i] = pictures_[i].name;
    const std::size_t first = firstAfterRollOver(names);
    // Times that say otherwise are believed.
    if (first == 0 || (hasTimes() && pictures_.front().about.taken < pictures_[first].about.taken)) return;
    std::rotate(pictures_.begin(), pictures_.begin() + static_cast<std::ptrdiff_t>(first), pictures_.end());
    note("the camera's counter began anew: " + pictures_.front().name + " is the first frame");
  }

  bool hasTimes() const {
    return std::none_of(pictures_.begin(), pictures_.end(),
                        [](const Picture& it) { return it.about.taken.empty(); });
  }

  void leaveOutOtherSizes() {
    const auto area = [](const Picture& it) {
      return std::make_pair(it.about.size.width, it.about.size.height);
    };
    std::map<std::pair<int, int>, std::size_t> count;
    for (const Picture& picture : pictures_) ++count[area(picture)];
    for (const auto& [size, number] : count) {
      if (size.first == 0 || 2 * number <= pictures_.size()) continue;
      leaveOut(
          cv::format("their size is not %dx%d, that of most", size.first, size.second),
          [&area, most = size](const Picture& it) { return it.about.size.area() > 0 && area(it) != most; });
      return;
    }
  }

  // A picture that was made long after all others is somebody's result, and no frame.
  void leaveOutLaterOnes() {
    constexpr std::size_t kFewest = 3;  // others; fewer tell no rhythm
    if (pictures_.size() <= kFewest) return;
    std::vector<fs::file_time_type> times;
    for (const Picture& picture : pictures_) times.push_back(picture.changed);
    std::sort(times.begin(), times.end());
    const auto last = times.back(), before = times[times.size() - 2];
    // Copying keeps the times of exposure or takes seconds; a result comes after both.
    const auto rhythm =
        std::max<fs::file_time_type::duration>(std::chrono::minutes(1), 10 * (before - times.front()));
    if (last - before <= rhythm) return;
    leaveOut("it was made long after all others", [last](const Picture& it) { return it.changed == last; });
  }

  void compareTimes() {
    if (!hasTimes()) return;
    for (std::size_t i = 1; i < pictures_.size(); ++i) {
      const Picture &one = pictures_[i - 1], &next = pictures_[i];
      if (one.about.taken <= next.about.taken) continue;
      note("names and times of exposure disagree: " + one.name + " was taken after " + next.name +
           "; the order is that of the names");
      return;
    }
  }

  // A camera on a stand does not turn within a bracket.
  void findOrientation() {
    std::map<Orientation, std::size_t> count;
    for (const Picture& picture : pictures_) ++count[picture.about.orientation];
    const auto most = std::max_element(count.begin(), count.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    files_.orientation = most->first;
    if (count.size() > 1)
      note("the EXIF orientation differs from frame to frame: that of most counts for all");
  }

  const std::string folder_;
  const std::set<std::string>& only_;
  std::vector<Picture> pictures_;
  StackFiles files_;
};

}  // namespace

StackFiles listStack(const std::string& folder, const std::set<std::string>& only) {
  return Listing(folder, only).make();
}

bool isPictureName(const std::string& name) {
  const std::string kind = ending(name);
  return kReadable.count(kind) + kCameraRaw.count(kind) + kOther.count(kind) > 0;
}

}  // namespace all_in_focus
