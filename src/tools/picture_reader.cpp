// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "picture_reader.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>
#include <vector>

#ifdef ALL_IN_FOCUS_LIBRAW
#include <libraw/libraw.h>
#endif
#ifdef ALL_IN_FOCUS_LIBHEIF
#include <libheif/heif.h>
#endif

#include "all_in_focus/codes.hpp"
#include "file_error.hpp"
#include "quiet_stderr.hpp"
#include "tiff_pages.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {
namespace {

const std::set<std::string> kHeif = {".heic", ".heif"};

bool startsWith(const std::string& data, const char* mark) {
  return data.rfind(mark, 0) == 0;
}

bool isPng(const std::string& data) {
  return startsWith(data, "\x89PNG\r\n\x1a\n");
}

bool isWholePng(const std::string& data) {
  return data.rfind("IEND") != std::string::npos;  // cameras append data after it
}

// Looks for the end mark behind the beginning of the image data: thumbnails before it have end marks of their
// own, and cameras append data after it.
bool isWholeJpeg(const std::string& data) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(data[i]); };
  std::size_t at = 2;
  while (at + 4 <= data.size() && byte(at) == 0xff) {
    if (byte(at + 1) == 0xff) {
      ++at;  // padding
    } else if (byte(at + 1) == 0xda) {
      return data.find("\xff\xd9", at) != std::string::npos;
    } else {
      at += 2 + (byte(at + 2) << 8 | byte(at + 3));
    }
  }
  return false;
}

bool isTiff(const std::string& data) {
  return data.size() >= 16 && (startsWith(data, "II") || startsWith(data, "MM"));
}

// The first bytes of a file.
std::string beginning(const std::string& path, std::size_t bytes) {
  std::string data(bytes, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(data.data(), static_cast<std::streamsize>(bytes));
  data.resize(static_cast<std::size_t>(file.gcount()));
  return data;
}

bool hasPngAlpha(const std::string& data) {
  if (!isPng(data) || data.size() < 26) return false;
  const std::string before_pixels = data.substr(0, data.find("IDAT"));
  return data[25] == 4 || data[25] == 6 || before_pixels.find("tRNS") != std::string::npos;
}

bool hasWebpAlpha(const std::string& data) {
  if (!startsWith(data, "RIFF") || data.size() < 25 || data.compare(8, 4, "WEBP") != 0) return false;
  return (data.compare(12, 4, "VP8X") == 0 && (data[20] & 0x10) != 0) ||
         (data.compare(12, 4, "VP8L") == 0 && (data[24] & 0x10) != 0);
}

// The highest code that a PNM file names, 0 = none: "P5", width, height, highest; comments begin with #.
int highestOfPnm(const std::string& path) {
  std::istringstream text(beginning(path, 512));
  std::vector<std::string> words;
  for (std::string word; words.size() < 4 && text >> word;) {
    if (word[0] == '#') {
      std::getline(text, word);
    } else {
      words.push_back(word);
    }
  }
  const bool is_pnm = words.size() == 4 && words[0].size() == 2 && words[0][0] == 'P' &&
                      std::string("2356").find(words[0][1]) != std::string::npos;
  if (!is_pnm || words[3].size() > 5 || words[3].find_first_not_of("0123456789") != std::string::npos)
    return 0;
  return std::stoi(words[3]);
}

std::string readFile(const std::string& path) {
  if (!fs::exists(path)) fail(path, "no such file");
  if (!fs::is_regular_file(path)) fail(path, "not a file");
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : -1;
  std::string data(size > 0 ? size : 0, '\0');
  if (size < 0 || !file.seekg(0).read(data.data(), size)) fail(path, "cannot be read");
  if (data.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()))
    fail(path, "larger than 2 GB: split it");
  return data;
}

cv::Mat decode(const std::string& path, std::string& data, int flags, const TiffPage& page) {
  if (isPng(data) && !isWholePng(data)) fail(path, "PNG is cut short: copy it again");
  if (startsWith(data, "\xff\xd8") && !isWholeJpeg(data)) fail(path, "JPEG is cut short: copy it again");
  if (isTiff(data) && page.at > 0) showTiffPage(data, page);
  cv::Mat image;
  if (!data.empty()) {
    const QuietStderr quiet;
    try {
      image = cv::imdecode(cv::Mat(1, static_cast<int>(data.size()), CV_8UC1, data.data()), flags);
    } catch (const cv::Exception&) {
    }
  }
  if (image.empty()) fail(path, "not an image that can be read");
  return image;
}

TiffPage findPage(const std::string& path, const std::string& data, int page) {
  if (!isTiff(data)) return {};
  const std::vector<TiffPage> pages = readTiffPages(path);
  if (page > 0 && page >= static_cast<int>(pages.size()))
    fail(path, "has no page " + std::to_string(page + 1));
  if (pages.empty()) return {};
  const TiffPage& found = pages[static_cast<std::size_t>(page)];
  if (page > 0 && found.size.empty()) fail(path, "TIFF is cut short: copy it again");
  return found;
}

#ifdef ALL_IN_FOCUS_LIBRAW
// As shot, all frames of a bracket alike: the camera's white balance, no exposure of its own.
cv::Mat readRaw(const std::string& path) {
  const auto raw = std::make_unique<LibRaw>();  // too large for the stack
  libraw_output_params_t& wanted = *raw->output_params_ptr();
  wanted.use_camera_wb = 1;
  wanted.no_auto_bright = 1;
  wanted.adjust_maximum_thr = 0;
  wanted.output_bps = 16;
  wanted.user_flip = 0;
  wanted.gamm[0] = 1 / 2.4;  // sRGB
  wanted.gamm[1] = 12.92;
  int failed = raw->open_file(path.c_str());
  if (failed == LIBRAW_SUCCESS) failed = raw->unpack();
  if (failed == LIBRAW_SUCCESS) failed = raw->dcraw_process();
  int width = 0, height = 0, colors = 0, bits = 0;
  raw->get_mem_image_format(&width, &height, &colors, &bits);
  if (failed != LIBRAW_SUCCESS || colors != 3 || bits != 16 || width <= 0 || height <= 0)
    fail(path, std::string("not a raw file that can be developed: ") + libraw_strerror(failed));
  cv::Mat image(height, width, CV_16UC3);
  failed = raw->copy_mem_image(image.data, static_cast<int>(image.step), /*bgr=*/1);
  if (failed != LIBRAW_SUCCESS) fail(path, libraw_strerror(failed));
  return image;
}
#endif

#ifdef ALL_IN_FOCUS_LIBHEIF
// Turned as the file says.
cv::Mat readHeif(const std::string& path, const std::string& data) {
  const std::unique_ptr<heif_context, decltype(&heif_context_free)> context(heif_context_alloc(),
                                                                            heif_context_free);
  heif_image_handle* handle = nullptr;
  heif_image* decoded = nullptr;
  heif_error error =
      heif_context_read_from_memory_without_copy(context.get(), data.data(), data.size(), nullptr);
  if (error.code == heif_error_Ok) error = heif_context_get_primary_image_handle(context.get(), &handle);
  const std::unique_ptr<const heif_image_handle, decltype(&heif_image_handle_release)> handle_owner(
      handle, heif_image_handle_release);
  if (error.code == heif_error_Ok)
    error = heif_decode_image(handle, &decoded, heif_colorspace_RGB, heif_chroma_interleaved_RGB, nullptr);
  const std::unique_ptr<const heif_image, decltype(&heif_image_release)> image_owner(decoded,
                                                                                     heif_image_release);
  if (error.code != heif_error_Ok) fail(path, std::string("not an image that can be read: ") + error.message);
  int step = 0;
  const std::uint8_t* pixels = heif_image_get_plane_readonly(decoded, heif_channel_interleaved, &step);
  const cv::Size size(heif_image_get_width(decoded, heif_channel_interleaved),
                      heif_image_get_height(decoded, heif_channel_interleaved));
  if (!pixels || size.area() <= 0) fail(path, "not an image that can be read");
  cv::Mat bgr;
  cv::cvtColor(cv::Mat(size, CV_8UC3, const_cast<std::uint8_t*>(pixels), static_cast<std::size_t>(step)), bgr,
               cv::COLOR_RGB2BGR);
  return bgr;
}
#endif

}  // namespace

const std::set<std::string>& plainEndings() {
  static const std::set<std::string> endings = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp",
                                                ".ppm", ".pgm", ".pnm",  ".jp2", ".webp"};
  return endings;
}

const std::set<std::string>& readableEndings() {
  static const std::set<std::string> endings = [] {
    std::set<std::string> all = plainEndings();
#ifdef ALL_IN_FOCUS_LIBRAW
    all.insert(rawEndings().begin(), rawEndings().end());
#endif
#ifdef ALL_IN_FOCUS_LIBHEIF
    all.insert(kHeif.begin(), kHeif.end());
#endif
    return all;
  }();
  return endings;
}

const std::set<std::string>& rawEndings() {
  static const std::set<std::string> endings = {".nef", ".nrw", ".cr2", ".cr3", ".crw", ".arw",
                                                ".srw", ".dng", ".raf", ".orf", ".rw2", ".pef",
                                                ".raw", ".3fr", ".iiq", ".x3f"};
  return endings;
}

const std::set<std::string>& otherEndings() {
  static const std::set<std::string> endings = {".heic", ".heif", ".avif", ".jxl",
                                                ".gif",  ".exr",  ".hdr",  ".psd"};
  return endings;
}

std::string ending(const std::string& path) {
  std::string ending = fs::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return ending;
}

int countPages(const std::string& path) {
  const std::string kind = ending(path);
  if (kind != ".tif" && kind != ".tiff") return 1;
  return std::max(1, static_cast<int>(readTiffPages(path).size()));
}

cv::Mat decodePicture(const std::string& path, int flags, int page) {
  std::string data = readFile(path);
  const TiffPage found = findPage(path, data, page);
  return decode(path, data, flags, found);
}

cv::Mat readPicture(const std::string& path, int page) {
#ifdef ALL_IN_FOCUS_LIBRAW
  if (rawEndings().count(ending(path)) > 0) return readRaw(path);
#endif
  std::string data = readFile(path);
#ifdef ALL_IN_FOCUS_LIBHEIF
  if (kHeif.count(ending(path)) > 0) return readHeif(path, data);
#endif
  const TiffPage found = findPage(path, data, page);
  const bool as_stored = found.has_alpha || found.bits > 8 || hasPngAlpha(data) || hasWebpAlpha(data);
  // Not turned: the calibration is of the sensor.
  const int flags = as_stored ? cv::IMREAD_UNCHANGED
                              : cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION;
  cv::Mat image = decode(path, data, flags, found);
  if (image.depth() == CV_64F) image.convertTo(image, CV_32F);
  if (image.depth() != CV_8U && image.depth() != CV_16U && image.depth() != CV_32F)
    fail(path, "its codes have a type that no camera writes: save it with 8 or 16 bits");
  if (image.channels() == 1) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  if (image.channels() != 3 && image.channels() != 4)
    fail(path, "a picture of two or more than four channels");
  if (image.channels() == 4) {
    double least = 0;
    cv::Mat alpha;
    cv::extractChannel(image, alpha, 3);
    cv::minMaxLoc(alpha, &least);
    if (least > 0) cv::cvtColor(image, image, cv::COLOR_BGRA2BGR);
  }
  return image;
}

bool hasOpenRange(const std::string& path) {
  const std::string kind = ending(path);
  if (kind == ".jp2") return true;
  if (kind == ".png") {
    const std::string head = beginning(path, 25);
    return isPng(head) && head.size() == 25 && head[24] == 16;
  }
  if (kind == ".tif" || kind == ".tiff") {
    const std::vector<TiffPage> pages = readTiffPages(path);
    return std::any_of(pages.begin(), pages.end(), [](const TiffPage& page) { return page.bits > 8; });
  }
  return highestOfPnm(path) > 255;
}

double highestCode(const std::string& path, int page, const cv::Mat& picture) {
  if (picture.depth() == CV_16U) {
    const int named = std::max(highestOfPnm(path), findPage(path, beginning(path, 16), page).highest);
    if (named > 255) return named;
  }
  cv::Mat color = picture;
  if (picture.channels() == 4) cv::cvtColor(picture, color, cv::COLOR_BGRA2BGR);
  if (picture.depth() == CV_32F) cv::patchNaNs(color = color.clone());
  double highest = 0;
  cv::minMaxLoc(color.reshape(1), nullptr, &highest);
  return highest;
}

double whiteCode(int depth, double highest) {
  if (depth == CV_8U) return 255;
  if (depth == CV_16U) return core::whiteCode(static_cast<int>(highest));
  constexpr double kBrighterThanWhite = 2;  // raw developers keep some of that
  if (highest <= kBrighterThanWhite) return 1;
  constexpr double kRounding = 1.1;  // of compressed floats
  if (highest <= kRounding * 255) return 255;
  if (highest <= kRounding * 65535) return 65535;
  throw std::invalid_argument(
      cv::format("float codes up to %g are none of 0..1, 0..255 and 0..65535: scale them", highest));
}

cv::Mat toFrame(const cv::Mat& picture, double white) {
  if (picture.depth() == CV_8U) return picture;
  cv::Mat source = picture, frame;
  if (picture.depth() == CV_32F) cv::patchNaNs(source = picture.clone());
  source.convertTo(frame, CV_16U, 65535 / white);
  return frame;
}

cv::Mat toColor(const cv::Mat& frame) {
  cv::Mat codes = core::toEightBits(frame);
  if (codes.channels() == 3) return codes;
  cv::Mat bgr;
  cv::cvtColor(codes, bgr, cv::COLOR_BGRA2BGR);
  return bgr;
}

}  // namespace all_in_focus
