// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "photo_metadata.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <exiv2/exiv2.hpp>
#include <filesystem>
#include <utility>

namespace all_in_focus {
namespace {

constexpr const char* kSoftware = "Exif.Image.Software";
constexpr const char* kOrientation = "Exif.Image.Orientation";
constexpr const char* kProfile = "Exif.Image.InterColorProfile";
constexpr const char *kFrames = "Xmp.dc.source", *kOptions = "Xmp.xmp.CreatorTool";
constexpr const char* kMark = "all_in_focus";
constexpr const char* kAlignedMark = "all_in_focus, aligned frame";

std::string text(const Exiv2::ExifData& exif, const char* key) {
  const auto found = exif.findKey(Exiv2::ExifKey(key));
  return found == exif.end() ? std::string() : found->toString();
}

std::string text(const Exiv2::XmpData& xmp, const char* key) {
  const auto found = xmp.findKey(Exiv2::XmpKey(key));
  return found == xmp.end() ? std::string() : found->toString();
}

std::string timeOf(const Exiv2::ExifData& exif) {
  std::string taken = text(exif, "Exif.Photo.DateTimeOriginal");
  const std::string fraction = text(exif, "Exif.Photo.SubSecTimeOriginal");
  if (!taken.empty() && !fraction.empty()) taken += "." + fraction;
  return taken;
}

Orientation orientationOf(const Exiv2::ExifData& exif) {
  const std::string value = text(exif, kOrientation);
  return value.size() == 1 && value[0] >= '1' && value[0] <= '8' ? value[0] - '0' : 1;
}

// Exiv2 prints its warnings to stderr.
void silence() {
  Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
}

// Copies what is true of the result, too: what the camera, its owner and the exposure were. Not how the
// pixels of the file are stored, nor its thumbnail.
void copyExif(const Exiv2::ExifData& from, Exiv2::ExifData& to) {
  static const std::array<const char*, 8> kOfTheScene = {
      "Exif.Image.Make",      "Exif.Image.Model",        "Exif.Image.DateTime",         "Exif.Image.Artist",
      "Exif.Image.Copyright", "Exif.Image.HostComputer", "Exif.Image.ImageDescription", "Exif.Image.Rating"};
  for (const Exiv2::Exifdatum& value : from) {
    const std::string group = value.groupName();
    const bool of_the_scene =
        std::find(kOfTheScene.begin(), kOfTheScene.end(), value.key()) != kOfTheScene.end();
    const bool of_the_pixels = value.tagName() == "PixelXDimension" || value.tagName() == "PixelYDimension";
    if (of_the_scene || ((group == "Photo" || group == "GPSInfo") && !of_the_pixels))
      to[value.key()] = value.value();
  }
}

// Colour profiles of TIFF files are among their EXIF data. Those of CMYK, Lab or gray are none for the
// result, which is RGB.
std::string profileOf(Exiv2::Image& image) {
  const auto in_exif = image.exifData().findKey(Exiv2::ExifKey(kProfile));
  std::string profile;
  if (in_exif != image.exifData().end()) {
    profile.resize(static_cast<std::size_t>(in_exif->size()));
    in_exif->copy(reinterpret_cast<Exiv2::byte*>(profile.data()), Exiv2::bigEndian);
  } else if (image.iccProfileDefined()) {
#if EXIV2_TEST_VERSION(0, 28, 0)
    const Exiv2::DataBuf& found = image.iccProfile();
    profile.assign(reinterpret_cast<const char*>(found.c_data()), found.size());
#else
    const Exiv2::DataBuf& found = *image.iccProfile();
    profile.assign(reinterpret_cast<const char*>(found.pData_), static_cast<std::size_t>(found.size_));
#endif
  }
  constexpr std::size_t kColorSpaceAt = 16;  // in its header
  if (profile.size() < kColorSpaceAt || profile.compare(kColorSpaceAt, 4, "RGB ") != 0) profile.clear();
  return profile;
}

void setProfile(Exiv2::Image& image, const std::string& profile) {
  Exiv2::DataBuf data(reinterpret_cast<const Exiv2::byte*>(profile.data()), profile.size());
#if EXIV2_TEST_VERSION(0, 28, 0)
  image.setIccProfile(std::move(data));
#else
  image.setIccProfile(data);
#endif
}

bool isPng(const std::string& data) {
  return data.rfind("\x89PNG", 0) == 0;
}

// Exiv2 0.27 gives the profile of a PNG no name, and libpng then ignores it. So it gets its chunk beforehand.
void addPngProfile(std::string& data, const std::string& profile) {
  constexpr std::size_t kBehindHead = 33;  // the signature and the chunk IHDR
  const auto bigEndian = [](unsigned long value) {
    return std::string{static_cast<char>(value >> 24), static_cast<char>(value >> 16),
                       static_cast<char>(value >> 8), static_cast<char>(value)};
  };
  uLongf size = compressBound(profile.size());
  std::string compressed(size, '\0');
  if (compress(reinterpret_cast<Bytef*>(compressed.data()), &size,
               reinterpret_cast<const Bytef*>(profile.data()), profile.size()) != Z_OK)
    return;
  compressed.resize(size);
  const std::string body =
      std::string("iCCPICC profile") + '\0' + '\0' + compressed;  // name, its end, method 0
  const unsigned long check =
      crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
  data.insert(kBehindHead, bigEndian(body.size() - 4) + body + bigEndian(check));
}

/// EXIF data and colour profile of a file, empty where it has none.
struct Copied {
  Exiv2::ExifData exif;
  std::string profile;
};

Copied readCopied(const std::string& path) {
  Copied copied;
  if (path.empty()) return copied;
  try {
    const auto image = Exiv2::ImageFactory::open(path);
    image->readMetadata();
    copyExif(image->exifData(), copied.exif);
    copied.profile = profileOf(*image);
  } catch (const std::exception&) {
    // A video, or a format without metadata.
  }
  return copied;
}

}  // namespace

PhotoMetadata readPhotoMetadata(const std::string& path) {
  silence();
  PhotoMetadata found;
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return found;  // a pipe would be waited for
  found.is_result = std::filesystem::exists(markBeside(path), error);
  try {
    const auto image = Exiv2::ImageFactory::open(path);
    image->readMetadata();
    found.size = {static_cast<int>(image->pixelWidth()), static_cast<int>(image->pixelHeight())};
    found.taken = timeOf(image->exifData());
    found.orientation = orientationOf(image->exifData());
    const std::string software = text(image->exifData(), kSoftware);
    found.is_result |= software.rfind(kMark, 0) == 0;
    found.is_aligned = software == kAlignedMark;
    found.frames = text(image->xmpData(), kFrames);
    found.options = text(image->xmpData(), kOptions);
  } catch (const std::exception&) {
    // A damaged picture is told where its pixels are read.
  }
  return found;
}

cv::Mat upright(const cv::Mat& image, Orientation orientation) {
  if (orientation == 1) return image;
  cv::Mat turned = image, flipped;
  if (orientation >= 5) cv::transpose(image, turned = cv::Mat());  // 5 to 8 lie on their sides
  // What is left then: mirrored left and right, up and down.
  const bool left_right = orientation == 2 || orientation == 3 || orientation == 6 || orientation == 7;
  const bool up_down = orientation == 3 || orientation == 4 || orientation == 7 || orientation == 8;
  if (!left_right && !up_down) return turned;
  cv::flip(turned, flipped, left_right && up_down ? -1 : left_right ? 1 : 0);
  return flipped;
}

cv::Size uprightSize(const cv::Size& stored, Orientation orientation) {
  return orientation >= 5 ? cv::Size(stored.height, stored.width) : stored;
}

std::string namesText(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

bool markAsResult(std::string& data, const PhotoSource& source) {
  silence();
  if (data.rfind("RIFF", 0) == 0) return false;  // WebP: decoders refuse what Exiv2 0.27 writes
  try {
    const Copied copied = readCopied(source.reference);
    std::string marked = data;
    if (isPng(data) && !copied.profile.empty()) addPngProfile(marked, copied.profile);
    const auto image =
        Exiv2::ImageFactory::open(reinterpret_cast<const Exiv2::byte*>(marked.data()), marked.size());
    image->readMetadata();
    for (const Exiv2::Exifdatum& value : copied.exif) image->exifData()[value.key()] = value.value();
    image->exifData()[kSoftware] = source.is_aligned ? kAlignedMark : kMark;
    if (source.orientation != 1)
      image->exifData()[kOrientation] = static_cast<std::uint16_t>(source.orientation);
    if (!isPng(data) && !copied.profile.empty()) setProfile(*image, copied.profile);
    if (!source.frames.empty()) image->xmpData()[kFrames] = source.frames;
    if (!source.options.empty()) image->xmpData()[kOptions] = source.options;
    image->writeMetadata();
    Exiv2::BasicIo& io = image->io();
    io.open();
    marked.resize(io.size());
    if (static_cast<std::size_t>(io.read(reinterpret_cast<Exiv2::byte*>(marked.data()), marked.size())) !=
        marked.size())
      return false;
    data = std::move(marked);
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

std::string markBeside(const std::string& path) {
  return path + ".all_in_focus";
}

}  // namespace all_in_focus
