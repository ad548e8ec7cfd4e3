// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "tiff_pages.hpp"

#include <algorithm>
#include <fstream>
#include <set>

namespace all_in_focus {
namespace {

constexpr std::size_t kMostPages = 65535;      // as many as a bracket has frames
constexpr std::uint64_t kMostEntries = 65535;  // of a directory

enum Tag : std::uint16_t {
  kSubfileType = 254,
  kWidth = 256,
  kHeight = 257,
  kBitsPerSample = 258,
  kPhotometric = 262,
  kOrientation = 274,
  kSamples = 277,
  kMaxSampleValue = 281,
  kExtraSamples = 338,
  kSMaxSampleValue = 341,
};

/// The two kinds of TIFF: classic, and BigTIFF for files of more than 4 GB.
struct Layout {
  bool big_endian = false, big = false;
  int offset_bytes() const { return big ? 8 : 4; }
  int count_bytes() const { return big ? 8 : 2; }
  int entry_bytes() const { return big ? 20 : 12; }
};

class TiffFile {
 public:
  explicit TiffFile(const std::string& path) : file_(path, std::ios::binary) {
    std::string mark(4, '\0');
    if (!file_.read(mark.data(), 4)) return;
    layout_.big_endian = mark[0] == 'M';
    const std::uint64_t version = get(2, 2);
    layout_.big = version == 43;
    is_tiff_ = (mark.rfind("II", 0) == 0 || mark.rfind("MM", 0) == 0) && (version == 42 || version == 43);
  }

  /// Offsets of directories, in their order; each once, also where they refer to each other in a circle.
  std::vector<std::uint64_t> directories() {
    std::vector<std::uint64_t> found;
    if (!is_tiff_) return found;
    std::set<std::uint64_t> known;
    std::uint64_t at = get(layout_.big ? 8 : 4, layout_.offset_bytes());
    while (at != 0 && found.size() < kMostPages && known.insert(at).second) {
      const std::uint64_t count = get(at, layout_.count_bytes());
      is_cut_ = !file_;
      if (is_cut_) break;
      found.push_back(at);
      at = get(at + layout_.count_bytes() + count * layout_.entry_bytes(), layout_.offset_bytes());
      if (!file_) break;
    }
    return found;
  }

  /// Whether the last directory that is named lies beyond the end.
  bool isCut() const { return is_cut_; }

  TiffPage page(std::uint64_t at, bool& is_thumbnail) {
    TiffPage page;
    page.at = at;
    const std::uint64_t count = std::min(get(at, layout_.count_bytes()), kMostEntries);
    at += layout_.count_bytes();
    std::string entries(count * layout_.entry_bytes(), '\0');
    seek(at);
    file_.read(entries.data(), static_cast<std::streamsize>(entries.size()));
    entries.resize(static_cast<std::size_t>(file_.gcount()));
    std::uint64_t samples = 1, photometric = 0;
    const auto entry_bytes = static_cast<std::size_t>(layout_.entry_bytes());
    for (std::size_t i = 0; i + entry_bytes <= entries.size(); i += entry_bytes) {
      const char* const entry = entries.data() + i;
      const std::uint64_t tag = number(entry, 2), type = number(entry + 2, 2);
      const std::uint64_t values = number(entry + 4, layout_.offset_bytes());
      if (values == 0) continue;
      const int value_at = 4 + layout_.offset_bytes();
      const int bytes = type == 3 ? 2 : type == 4 ? 4 : type == 16 ? 8 : 1;
      const bool is_elsewhere = values > static_cast<std::uint64_t>(layout_.offset_bytes() / bytes);
      const std::uint64_t value = is_elsewhere ? get(number(entry + value_at, layout_.offset_bytes()), bytes)
                                               : number(entry + value_at, bytes);
      if (tag == kSubfileType) is_thumbnail = (value & 1) != 0;
      if (tag == kWidth) page.size.width = static_cast<int>(std::min<std::uint64_t>(value, 1 << 30));
      if (tag == kHeight) page.size.height = static_cast<int>(std::min<std::uint64_t>(value, 1 << 30));
      if (tag == kBitsPerSample) page.bits = static_cast<int>(std::min<std::uint64_t>(value, 64));
      if (tag == kPhotometric) photometric = value;
      if (tag == kSamples) samples = value;
      const bool is_whole_number = type == 3 || type == 4;
      if ((tag == kMaxSampleValue || tag == kSMaxSampleValue) && is_whole_number)
        page.highest = static_cast<int>(std::min<std::uint64_t>(value, 65535));
      if (tag == kOrientation) page.orientations.push_back(at + i + static_cast<std::uint64_t>(value_at));
      if (tag == kExtraSamples) page.has_alpha = true;
    }
    // Some programs do not say what the sample behind gray or RGB is.
    page.has_alpha =
        page.has_alpha || (photometric == 2 && samples == 4) || (photometric < 2 && samples == 2);
    if (page.bits > 8 && page.bits < 16) page.highest = 65535;  // OpenCV spreads packed codes over 16 bits
    return page;
  }

 private:
  void seek(std::uint64_t at) {
    file_.clear();  // what was beyond the end
    file_.seekg(static_cast<std::streamoff>(at & 0x7fffffffffffffff));
  }

  std::uint64_t number(const char* bytes, int count) const {
    std::uint64_t value = 0;
    for (int i = 0; i < count; ++i)
      value = value << 8 | static_cast<unsigned char>(bytes[layout_.big_endian ? i : count - 1 - i]);
    return value;
  }

  std::uint64_t get(std::uint64_t at, int bytes) {
    char raw[8] = {};
    seek(at);
    file_.read(raw, bytes);
    return number(raw, bytes);
  }

  std::ifstream file_;
  Layout layout_;
  bool is_tiff_ = false, is_cut_ = false;
};

}  // namespace

std::vector<TiffPage> readTiffPages(const std::string& path) {
  TiffFile file(path);
  std::vector<TiffPage> pages;
  for (const std::uint64_t at : file.directories()) {
    bool is_thumbnail = false;
    const TiffPage page = file.page(at, is_thumbnail);
    if (pages.empty() || (!is_thumbnail && page.size == pages.front().size)) pages.push_back(page);
  }
  if (pages.size() > 1 && file.isCut()) pages.emplace_back();
  return pages;
}

void showTiffPage(std::string& data, const TiffPage& page) {
  const bool big_endian = data[0] == 'M', big = data[big_endian ? 3 : 2] == 43;
  const auto set = [&](std::uint64_t at, std::uint64_t value, int bytes) {
    if (at > data.size() || data.size() - at < static_cast<std::size_t>(bytes)) return;
    for (int i = 0; i < bytes; ++i)
      data[at + (big_endian ? bytes - 1 - i : i)] = static_cast<char>(value >> 8 * i & 255);
  };
  set(big ? 8 : 4, page.at, big ? 8 : 4);
  for (const std::uint64_t at : page.orientations) set(at, 1, 2);
}

}  // namespace all_in_focus
