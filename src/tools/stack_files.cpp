// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "stack_files.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>

#include "file_error.hpp"
#include "image_files.hpp"
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

bool isDigit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

/// A name cut into text and numbers: "img (10).png" is "img (", 10, ").png".
struct Parts {
  std::vector<std::string> text;     ///< in lower case; before, between and behind the numbers
  std::vector<std::string> numbers;  ///< digits
};

Parts split(const std::string& name) {
  Parts parts{{""}, {}};
  for (std::size_t i = 0; i < name.size(); ++i) {
    if (!isDigit(name[i])) {
      parts.text.back() += static_cast<char>(std::tolower(static_cast<unsigned char>(name[i])));
      continue;
    }
    const std::size_t begin = i;
    while (i + 1 < name.size() && isDigit(name[i + 1])) ++i;
    parts.numbers.push_back(name.substr(begin, i + 1 - begin));
    parts.text.emplace_back();
  }
  return parts;
}

std::string withoutZeros(const std::string& digits) {
  return digits.substr(std::min(digits.find_first_not_of('0'), digits.size() - 1));
}

int sign(std::size_t a, std::size_t b) {
  return a < b ? -1 : a > b ? 1 : 0;
}

// Numbers of any length.
int compareDigits(const std::string& a, const std::string& b) {
  const std::string left = withoutZeros(a), right = withoutZeros(b);
  const int by_length = sign(left.size(), right.size());
  return by_length != 0 ? by_length : left.compare(right);
}

/// The places (number of the number in the name) at which a minus before digits is a sign and no hyphen:
/// where names that are else alike have a plus or nothing before theirs.
class Signs {
 public:
  explicit Signs(const std::vector<Parts>& names) {
    std::map<std::pair<std::string, std::size_t>, std::set<char>> before;
    for (const Parts& name : names) {
      for (std::size_t i = 0; i < name.numbers.size(); ++i)
        before[{stem(name.text[i]), i}].insert(mark(name.text[i]));
    }
    for (const auto& [place, marks] : before) {
      if (marks.count('-') != 0 && marks.size() > 1) signed_.insert(place);
    }
  }

  bool negative(const Parts& name, std::size_t i) const {
    return isSigned(name, i) && mark(name.text[i]) == '-';
  }

  /// The text before number i, without its sign; behind the last number, the text there.
  std::string before(const Parts& name, std::size_t i) const {
    return i < name.numbers.size() && isSigned(name, i) ? stem(name.text[i]) : name.text[i];
  }

 private:
  static char mark(const std::string& text) {
    return !text.empty() && (text.back() == '-' || text.back() == '+') ? text.back() : ' ';
  }
  static std::string stem(const std::string& text) {
    return mark(text) == ' ' ? text : text.substr(0, text.size() - 1);
  }
  bool isSigned(const Parts& name, std::size_t i) const {
    return signed_.count({stem(name.text[i]), i}) != 0;
  }

  std::set<std::pair<std::string, std::size_t>> signed_;
};

int compareNames(const Parts& a, const Parts& b, const Signs& signs) {
  const std::size_t numbers = std::min(a.numbers.size(), b.numbers.size());
  for (std::size_t i = 0; i < numbers; ++i) {
    if (const int text = signs.before(a, i).compare(signs.before(b, i)); text != 0) return text;
    const bool minus_a = signs.negative(a, i), minus_b = signs.negative(b, i);
    if (minus_a != minus_b) return minus_a ? -1 : 1;
    if (const int number = compareDigits(a.numbers[i], b.numbers[i]); number != 0)
      return minus_a ? -number : number;
  }
  if (const int text = signs.before(a, numbers).compare(signs.before(b, numbers)); text != 0) return text;
  return sign(a.numbers.size(), b.numbers.size());
}

/// Where the names, sorted by number, begin in time: behind the place at which a camera's counter began anew
/// (9999, then 0000 or 0001). 0 where it did not. The counter: the one number that differs, padded to at
/// least four digits.
std::size_t firstAfterRollOver(const std::vector<Parts>& names) {
  constexpr std::size_t kFewestDigits = 4;  // of all makers
  if (names.size() < 2) return 0;
  const Parts& model = names.front();
  std::size_t counter = model.numbers.size();
  for (const Parts& name : names) {
    if (name.text != model.text) return 0;
    for (std::size_t i = 0; i < model.numbers.size(); ++i) {
      if (name.numbers[i] == model.numbers[i]) continue;
      if (counter != model.numbers.size() && counter != i) return 0;
      counter = i;
    }
  }
  if (counter == model.numbers.size()) return 0;
  const std::size_t digits = model.numbers[counter].size();
  if (digits < kFewestDigits || digits > 9) return 0;
  std::vector<std::int64_t> values;
  for (const Parts& name : names) {
    if (name.numbers[counter].size() != digits) return 0;
    values.push_back(std::stoll(name.numbers[counter]));
  }
  const auto round = static_cast<std::int64_t>(std::llround(std::pow(10.0, static_cast<double>(digits))));
  // Whoever numbers by hand leaves no gap of half the counter.
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (values[i] - values[i - 1] > round / 2) return i;
  }
  return 0;
}

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
    std::vector<Parts> names;
    for (const Picture& picture : pictures_) names.push_back(split(picture.name));
    const Signs signs(names);
    std::sort(pictures_.begin(), pictures_.end(), [&signs](const Picture& a, const Picture& b) {
      const int by_name = compareNames(split(a.name), split(b.name), signs);
      if (by_name != 0) return by_name < 0;
      return a.about.taken != b.about.taken ? a.about.taken < b.about.taken : a.name < b.name;
    });
    for (std::size_t i = 0; i < pictures_.size(); ++i) names[i] = split(pictures_[i].name);
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

std::vector<std::string> inNaturalOrder(const std::vector<std::string>& paths) {
  std::vector<std::pair<Parts, std::string>> named;
  for (const std::string& path : paths) named.emplace_back(split(fs::path(path).filename().string()), path);
  std::vector<Parts> names;
  for (const auto& one : named) names.push_back(one.first);
  const Signs signs(names);
  std::sort(named.begin(), named.end(), [&signs](const auto& a, const auto& b) {
    const int by_name = compareNames(a.first, b.first, signs);
    return by_name != 0 ? by_name < 0 : a.second < b.second;
  });
  std::vector<std::string> sorted;
  for (const auto& one : named) sorted.push_back(one.second);
  return sorted;
}

bool isPictureName(const std::string& name) {
  const std::string kind = ending(name);
  return kReadable.count(kind) + kCameraRaw.count(kind) + kOther.count(kind) > 0;
}

}  // namespace all_in_focus
