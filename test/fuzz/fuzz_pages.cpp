// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Files of frames: the pages of a TIFF, one after the other, transparency, raw files, and what codes mean.

#include <opencv2/imgproc.hpp>

#include "image_files.hpp"
#include "picture_reader.hpp"
#include "scratch_folder.hpp"
#include "target.hpp"
#include "tiff_pages.hpp"

namespace all_in_focus::fuzz {
namespace {

const char* const kNames[] = {"x.tif", "x.dng", "x.heic", "x.png", "x.ppm"};
constexpr int kMostRead = 8;  // pages; a file may name thousands

void run(Input& input) {
  static const ScratchFolder folder;
  const std::string name = kNames[input.below(std::size(kNames))];
  const std::string path = folder.write(name, input.rest());
  const int pages = countPages(path);
  require(pages >= 1, "no page");
  hasOpenRange(path);
  for (int i = 0; i < std::min(pages, kMostRead); ++i) {
    cv::Mat picture, frame;
    if (!accepts([&] { picture = readPicture(path, i); })) continue;
    const int depth = picture.depth(), channels = picture.channels();
    require(depth == CV_8U || depth == CV_16U || depth == CV_32F, "a depth that nobody knows");
    require(channels == 3 || channels == 4, "neither colour nor colour and alpha");
    if (!accepts([&] { frame = toFrame(picture, whiteCode(depth, highestCode(path, i, picture))); }))
      continue;
    require(frame.size() == picture.size() && frame.channels() == channels, "another picture");
    require(frame.depth() == (depth == CV_8U ? CV_8U : CV_16U), "another depth");
  }
  accepts([&] { readPicture(path, pages); });
}

/// Bytes of numbers in the order of a TIFF.
class Bytes {
 public:
  explicit Bytes(bool big_endian) : big_endian_(big_endian) { bytes = big_endian ? "MM" : "II"; }
  Bytes& put(std::uint64_t value, int size) {
    for (int i = 0; i < size; ++i)
      bytes += static_cast<char>(value >> 8 * (big_endian_ ? size - 1 - i : i) & 255);
    return *this;
  }
  std::string bytes;

 private:
  const bool big_endian_;
};

// Gray pages of 4 x 4 pixels; the directory of each lies before its pixels.
std::string tiff(bool big_endian, bool big, int pages, int bits, bool alpha) {
  Bytes file(big_endian);
  const int offset_size = big ? 8 : 4, count_size = big ? 8 : 2, entry_size = big ? 20 : 12;
  file.put(big ? 43 : 42, 2);
  if (big) file.put(8, 2).put(0, 2);
  file.put(big ? 16 : 8, offset_size);
  const int samples = alpha ? 2 : 1, pixels = 4 * 4 * samples * bits / 8;
  const std::vector<std::pair<int, int>> tags = {{254, 0},
                                                 {256, 4},
                                                 {257, 4},
                                                 {258, bits},
                                                 {259, 1},
                                                 {262, 1},
                                                 {273, 0},
                                                 {274, 6},
                                                 {277, samples},
                                                 {278, 4},
                                                 {279, pixels},
                                                 {338, 2},
                                                 {339, bits == 32 ? 3 : 1}};
  for (int page = 0; page < pages; ++page) {
    const std::size_t size = count_size + tags.size() * entry_size + offset_size;
    const std::size_t at_pixels = file.bytes.size() + size;
    file.put(tags.size(), count_size);
    for (const auto& [tag, value] : tags) {
      file.put(tag == 338 && !alpha ? 305 : tag, 2).put(big ? 16 : 4, 2).put(1, offset_size);
      file.put(tag == 273 ? at_pixels : static_cast<std::uint64_t>(value), offset_size);
    }
    file.put(page + 1 < pages ? at_pixels + pixels : 0, offset_size);
    for (int i = 0; i < pixels; ++i) file.put(i * 37 % 64, 1);
  }
  return file.bytes;
}

// A raw file of 16 bits: a Bayer pattern, 32 x 32.
std::string dng() {
  struct Entry {
    int tag, type, count;
    std::uint32_t value;
  };
  constexpr int kByte = 1, kShort = 3, kLong = 4, kSide = 32, kPixels = kSide * kSide * 2;
  const std::vector<Entry> entries = {{254, kLong, 1, 0},
                                      {256, kLong, 1, kSide},
                                      {257, kLong, 1, kSide},
                                      {258, kShort, 1, 16},
                                      {259, kShort, 1, 1},
                                      {262, kShort, 1, 32803},
                                      {273, kLong, 1, 8 + 2 + 13 * 12 + 4},
                                      {277, kShort, 1, 1},
                                      {278, kLong, 1, kSide},
                                      {279, kLong, 1, kPixels},
                                      {33421, kShort, 2, 0x00020002},
                                      {33422, kByte, 4, 0x02010100},
                                      {50706, kByte, 4, 0x00000401}};
  Bytes file(/*big_endian=*/false);
  file.put(42, 2).put(8, 4).put(entries.size(), 2);
  for (const Entry& entry : entries)
    file.put(entry.tag, 2).put(entry.type, 2).put(entry.count, 4).put(entry.value, 4);
  file.put(0, 4);
  for (int i = 0; i < kPixels; ++i) file.put(i * 37 % 64, 1);
  return file.bytes;
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  cv::Mat4b picture(5, 6, cv::Vec4b(10, 120, 200, 255));
  picture(2, 3)[3] = 0;
  cv::Mat4w deep;
  picture.convertTo(deep, CV_16U, 257);
  cv::Mat3b opaque;
  cv::cvtColor(picture, opaque, cv::COLOR_BGRA2BGR);
  seeds.push_back(Seed().below(1).rest(dng()));
  seeds.push_back(
      Seed().below(2).rest(std::string("\0\0\0\x18"
                                       "ftypheic\0\0\0\0mif1heic",
                                       24)));
  for (const cv::Mat& with_alpha : {cv::Mat(picture), cv::Mat(deep)})
    seeds.push_back(Seed().below(3).rest(encodeImage("x.png", with_alpha)));
  seeds.push_back(Seed().below(3).rest(encodeImage("x.webp", picture)));
  seeds.push_back(Seed().below(4).rest(encodeImage("x.ppm", opaque)));
  for (const bool big_endian : {false, true}) {
    for (const bool big : {false, true}) {
      for (const int bits : {8, 16, 32}) {
        for (const int pages : {1, 3})
          seeds.push_back(Seed().below(0).rest(tiff(big_endian, big, pages, bits, pages == 3)));
      }
    }
  }
  std::string circle = tiff(false, false, 1, 8, false);
  circle[8 + 2 + 13 * 12] = 8;  // the next directory is the first one
  seeds.push_back(Seed().below(0).rest(circle));
  return seeds;
}

const FuzzTarget target("pages", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
