// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Metadata of photos: what any bytes say of themselves, and a result that takes them over.

#include "image_files.hpp"
#include "images.hpp"
#include "photo_metadata.hpp"
#include "scratch_folder.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

const char* const kNames[] = {"x.png", "x.jpg", "x.tif", "x.webp"};

void run(Input& input) {
  static const ScratchFolder folder;
  const std::string name = kNames[input.below(std::size(kNames))];
  PhotoSource source;
  source.orientation = 1 + input.below(8);
  source.frames = input.text();
  source.options = input.text();
  const cv::Mat picture = pictureFrom(input, {12, 10});
  source.reference = folder.write("reference", input.rest());
  const PhotoMetadata reference = readPhotoMetadata(source.reference);
  require(reference.orientation >= 1 && reference.orientation <= 8, "no orientation");

  std::string data = encodeImage(name, picture);
  const cv::Mat before = readColor(folder.write(name, data));
  const bool is_marked = markAsResult(data, source);
  require(isSame(readColor(folder.write(name, data)), before), "other pixels");
  if (!is_marked) return;
  const PhotoMetadata result = readPhotoMetadata(folder.path() + "/" + name);
  require(result.is_result, "not marked");
  require(result.orientation == source.orientation, "another orientation");
  require(result.size == picture.size(), "another size");
  require(upright(before, result.orientation).size() == uprightSize(before.size(), result.orientation),
          "turned to another size");
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  const cv::Mat picture(9, 11, CV_8UC3, cv::Scalar(10, 120, 200));
  for (int i = 0; i < static_cast<int>(std::size(kNames)); ++i) {
    for (const char* reference : kNames) {
      std::string data = encodeImage(reference, picture);
      markAsResult(data, {"", "00.png, \xc3\xa4.jpg", 6, "fuse_stack --crop"});
      Seed seed;
      seed.below(i).below(i).text("a.png, \xff, b.jpg").text("fuse_stack");
      seeds.push_back(putPicture(seed, 20, 200, 1).rest(data));
    }
  }
  return seeds;
}

const FuzzTarget target("photo", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
