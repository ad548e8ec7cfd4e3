// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "photo_metadata.hpp"

#include <exiv2/exiv2.hpp>
#include <filesystem>

namespace all_in_focus {
namespace {

constexpr const char* kSoftware = "Exif.Image.Software";
constexpr const char* kMark = "all_in_focus";

std::string text(const Exiv2::ExifData& exif, const char* key) {
  const auto found = exif.findKey(Exiv2::ExifKey(key));
  return found == exif.end() ? std::string() : found->toString();
}

std::string timeOf(const Exiv2::ExifData& exif) {
  std::string taken = text(exif, "Exif.Photo.DateTimeOriginal");
  const std::string fraction = text(exif, "Exif.Photo.SubSecTimeOriginal");
  if (!taken.empty() && !fraction.empty()) taken += "." + fraction;
  return taken;
}

// Exiv2 prints its warnings to stderr.
void silence() {
  Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
}

}  // namespace

PhotoMetadata readPhotoMetadata(const std::string& path) {
  silence();
  PhotoMetadata found;
  found.is_result = std::filesystem::exists(markBeside(path));
  try {
    const auto image = Exiv2::ImageFactory::open(path);
    image->readMetadata();
    found.size = {image->pixelWidth(), image->pixelHeight()};
    found.taken = timeOf(image->exifData());
    found.is_result |= text(image->exifData(), kSoftware).rfind(kMark, 0) == 0;
  } catch (const std::exception&) {
    // A damaged picture is told where its pixels are read.
  }
  return found;
}

bool markAsResult(std::string& data) {
  silence();
  try {
    const auto image =
        Exiv2::ImageFactory::open(reinterpret_cast<const Exiv2::byte*>(data.data()), data.size());
    image->readMetadata();
    image->exifData()[kSoftware] = kMark;
    image->writeMetadata();
    Exiv2::BasicIo& io = image->io();
    io.open();
    std::string marked(io.size(), '\0');
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
