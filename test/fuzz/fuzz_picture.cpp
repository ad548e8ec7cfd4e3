// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Picture files: any bytes, and whole pictures that are cut short, which must never be taken for whole ones.

#include <opencv2/imgcodecs.hpp>

#include "image_files.hpp"
#include "images.hpp"
#include "scratch_folder.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

const char* const kNames[] = {"x.png", "x.jpg", "x.tif", "x.bmp", "x.ppm", "x.webp"};
const int kTypes[] = {CV_8UC1, CV_8UC3, CV_16UC1, CV_16UC3};

const ScratchFolder& folder() {
  static const ScratchFolder folder;
  return folder;
}

void readAnything(const std::string& path) {
  cv::Mat image;
  if (accepts([&] { image = readColor(path); }))
    require(!image.empty() && image.type() == CV_8UC3, "no colour image");
  if (accepts([&] { image = readHalfColor(path); }))
    require(!image.empty() && image.type() == CV_8UC3, "no colour image of half size");
  if (accepts([&] { image = readDepth(path); }))
    require(image.type() == CV_16UC1 && cv::countNonZero(image) > 0, "no depth");
  if (accepts([&] { image = readLabelMap(path, -1); }))
    require(!image.empty() && image.type() == CV_32SC1, "no labels");
}

void requireLabels(const std::string& path, const cv::Mat& values, int unknown) {
  const cv::Mat labels = readLabelMap(path, unknown);
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      const int value =
          values.depth() == CV_8U ? values.at<std::uint8_t>(y, x) : values.at<std::uint16_t>(y, x);
      const int expected = value == unknown ? 0 : unknown > 0 ? value + 1 : value;
      require(labels.at<int>(y, x) == expected, "another label");
    }
  }
}

// A picture that OpenCV writes and the product reads, whole and cut short.
void readMade(Input& input) {
  const std::string name = kNames[input.below(std::size(kNames))];
  const int type = kTypes[input.below(std::size(kTypes))];
  const std::uint16_t end = input.take<std::uint16_t>();
  const int unknown = input.take<std::int16_t>();
  cv::Mat image(sizeFrom(input), type);
  if (image.empty()) return;
  std::minstd_rand random(input.take<std::uint8_t>());
  for (std::size_t i = 0; i < image.total() * image.elemSize(); ++i)
    image.data[i] = static_cast<std::uint8_t>(random() >> 8 & input.take<std::uint8_t>());

  std::string bytes;
  if (!accepts([&] { bytes = encodeImage(name, image); })) return;
  const std::string path = folder().write(name, bytes);
  const cv::Mat whole = readColor(path);
  require(whole.size() == image.size(), name + " has another size than was written");
  if (type == CV_16UC1 && cv::countNonZero(image) > 0)
    require(isSame(readDepth(path, {}), image), "other depth than was written");
  const bool is_exact = name != "x.jpg" && name != "x.webp";
  if (is_exact && image.channels() == 1 && name != "x.ppm") requireLabels(path, image, unknown);

  cv::Mat cut;
  folder().write(name, bytes.substr(0, end % (bytes.size() + 1)));
  if (accepts([&] { cut = readColor(path); })) require(isSame(cut, whole), name + " cut short is accepted");
  readAnything(path);
}

void run(Input& input) {
  if (input.flag()) return readMade(input);
  readAnything(folder().write("any", input.rest()));
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  cv::Mat3b picture(9, 11);
  cv::RNG random(1);
  random.fill(picture, cv::RNG::UNIFORM, 0, 256);
  for (int i = 0; i < static_cast<int>(std::size(kNames)); ++i) {
    seeds.push_back(Seed().flag(false).rest(encodeImage(kNames[i], picture)));
    for (int type = 0; type < static_cast<int>(std::size(kTypes)); ++type) {
      for (const std::uint16_t end : std::initializer_list<std::uint16_t>{40, 150, 65535}) {
        seeds.push_back(Seed()
                            .flag(true)
                            .below(i)
                            .below(type)
                            .put(end)
                            .put<std::int16_t>(7)
                            .below(11)
                            .below(9)
                            .below(type)
                            .rest(std::string(600, '\xff')));
      }
    }
  }
  cv::Mat depth;
  picture.reshape(1).convertTo(depth, CV_16U, 250);
  seeds.push_back(Seed().flag(false).rest(encodeImage("x.png", depth)));
  seeds.push_back(Seed().flag(false).rest(encodeImage("x.tif", depth)));
  seeds.push_back(Seed().flag(false).rest(std::string("II+\0", 4) + std::string(13, '\0')));  // BigTIFF, cut
  // A thumbnail before the picture, bytes after it, and several scans.
  const std::string jpeg = encodeImage("x.jpg", picture);
  const std::string thumbnail = std::string("\xff\xe1\x01\x00", 4) + jpeg.substr(0, 254);
  seeds.push_back(Seed().flag(false).rest(jpeg.substr(0, 2) + thumbnail + jpeg.substr(2) + "after it"));
  std::vector<unsigned char> progressive;
  cv::imencode(".jpg", picture, progressive, {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  seeds.push_back(Seed().flag(false).rest({progressive.begin(), progressive.end()}));
  return seeds;
}

const FuzzTarget target("picture", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
