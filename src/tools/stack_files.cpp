// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "stack_files.hpp"

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "file_error.hpp"
#include "natural_order.hpp"
#include "photo_metadata.hpp"
#include "picture_reader.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

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

constexpr const char* kPage = ", page ";

// What messages call a page of a TIFF.
std::string nameOf(const std::string& file, int page) {
  return file + kPage + std::to_string(page + 1);
}

std::string stem(const Picture& picture) {
  return fs::path(picture.name).stem().string();
}

/// Sorts out the pictures of one folder, or of one file.
class Listing {
 public:
  Listing(const std::string& path, const std::set<std::string>& only, bool plain)
      : folder_(path), only_(only), plain_(plain) {}

  StackFiles make() {
    if (!fs::is_directory(folder_) && fs::is_regular_file(folder_)) {
      addPages(folder_);
      files_.orientation = readPhotoMetadata(folder_).orientation;
      return files_;
    }
    collect();
    leaveOut("earlier results of this package", [](const Picture& it) { return it.about.is_result; });
    chooseRawOrPictures();
    sort();
    leaveOutOtherSizes();
    leaveOutLaterOnes();
    if (pictures_.empty())
      fail(folder_, "the folder holds no image" + (files_.notes.empty() ? "" : ": " + files_.notes[0]));
    findTwins();
    compareTimes();
    findOrientation();
    for (const Picture& picture : pictures_) addPages((fs::path(folder_) / picture.name).string());
    return files_;
  }

 private:
  void note(const std::string& text) { files_.notes.push_back(folder_ + ": " + text); }

  void collect() {
    std::vector<std::string> unreadable, raw, lost;
    std::error_code unreadable_folder, error;
    for (const auto& entry : fs::directory_iterator(folder_, unreadable_folder)) {
      const std::string name = entry.path().filename().string(), kind = ending(name);
      if (name[0] == '.' || entry.is_directory(error) || !isWanted(name)) continue;
      const bool is_readable = (plain_ ? plainEndings() : readableEndings()).count(kind) != 0;
      if (!is_readable && rawEndings().count(kind) != 0) raw.push_back(name);
      if (!is_readable && otherEndings().count(kind) != 0) unreadable.push_back(name);
      if (!is_readable) continue;
      if (!entry.is_regular_file(error)) {
        lost.push_back(name);
        continue;
      }
      pictures_.push_back(
          {name, readPhotoMetadata(entry.path().string()), fs::last_write_time(entry.path(), error)});
    }
    if (unreadable_folder) fail(folder_, "cannot be read: " + unreadable_folder.message());
    tell(raw, plain_ ? "camera raw files cannot be read but by fuse_stack with LibRaw: develop them first"
                     : "camera raw files cannot be read: develop them first, or build with LibRaw");
    tell(unreadable, "pictures of this format cannot be read: convert them first, to PNG, TIFF or JPEG");
    tell(lost, "no file is there: a broken link, or no regular file");
  }

  // Whether the file, or a page of it, is a frame to look at.
  bool isWanted(const std::string& file) const {
    return only_.empty() || std::any_of(only_.begin(), only_.end(), [&](const std::string& frame) {
             return frame == file || frame.rfind(file + kPage, 0) == 0;
           });
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

  // Cameras write both of one shot.
  void chooseRawOrPictures() {
    const auto isRaw = [](const Picture& it) { return rawEndings().count(ending(it.name)) != 0; };
    std::set<std::string> raw;
    for (const Picture& picture : pictures_) {
      if (isRaw(picture)) raw.insert(stem(picture));
    }
    if (raw.empty()) return;
    const bool have_all = std::all_of(pictures_.begin(), pictures_.end(),
                                      [&](const Picture& it) { return raw.count(stem(it)) != 0; });
    if (have_all)
      return leaveOut("the camera raw files of the same shots are read",
                      [&](const Picture& it) { return !isRaw(it); });
    leaveOut("camera raw files beside pictures that have none: the pictures are read", isRaw);
  }

  void addPages(const std::string& path) {
    const std::string file = fs::path(path).filename().string();
    const int pages = countPages(path);
    if (pages > 1 && path != folder_)
      note(file + " has " + std::to_string(pages) + " pages: each is a frame");
    for (int i = 0; i < pages; ++i) {
      const std::string name = pages > 1 ? nameOf(file, i) : file;
      if (!only_.empty() && only_.count(name) == 0) continue;
      files_.frames.push_back(name);
      files_.sources.push_back({path, i});
    }
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

  // Cameras and programs that develop pictures write one shot twice. Nothing tells which one is meant.
  void findTwins() {
    std::set<std::string> stems;
    std::vector<std::string> twins;
    for (const Picture& picture : pictures_) {
      if (!stems.insert(stem(picture)).second) twins.push_back(picture.name);
    }
    if (!twins.empty())
      note(listed(twins) +
           ": the same name has another ending, too, and both are frames: keep one of each shot");
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
  const bool plain_;
  std::vector<Picture> pictures_;
  StackFiles files_;
};

}  // namespace

StackFiles listStack(const std::string& path, const std::set<std::string>& only, bool plain) {
  return Listing(path, only, plain).make();
}

bool holdsPictures(const std::string& path) {
  return fs::is_directory(path) || (fs::is_regular_file(path) && countPages(path) > 1);
}

bool isPictureName(const std::string& name) {
  const std::string kind = ending(name);
  return readableEndings().count(kind) + rawEndings().count(kind) + otherEndings().count(kind) > 0;
}

}  // namespace all_in_focus
