// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Image messages as depth, compared with a plain definition.

#include <sensor_msgs/image_encodings.h>

#include <cmath>

#include "conversions.hpp"
#include "image_messages.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr int kMostInvalid = 5;

int plainDepth(const sensor_msgs::Image& image, unsigned x, unsigned y,
               const std::vector<int>& invalid_values) {
  int mm = 0;
  if (image.encoding == enc::TYPE_32FC1) {
    float m = 0;
    std::memcpy(&m, &image.data[y * image.step + x * sizeof m], sizeof m);
    const float rounded = std::isfinite(m) ? std::floor(m * 1000.0f + 0.5f) : 0;
    mm = rounded >= 1 && rounded <= 65535 ? static_cast<int>(rounded) : 0;
  } else {
    std::uint16_t value = 0;
    std::memcpy(&value, &image.data[y * image.step + x * sizeof value], sizeof value);
    mm = value;
  }
  return std::count(invalid_values.begin(), invalid_values.end(), mm) > 0 ? 0 : mm;
}

void run(Input& input) {
  const sensor_msgs::ImagePtr image = imageFrom(input);
  std::vector<int> invalid_values(input.below(kMostInvalid));
  for (int& value : invalid_values) value = input.take<std::int32_t>();
  const std::string data = input.rest();
  image->data.assign(data.begin(), data.end());

  const sensor_msgs::Image before = *image;
  cv::Mat depth;
  if (!accepts([&] { depth = toDepth(*image, invalid_values, "/depth"); })) return;
  require(image->data == before.data, "the message has changed");
  require(depth.type() == CV_16UC1 && static_cast<unsigned>(depth.cols) == image->width &&
              static_cast<unsigned>(depth.rows) == image->height,
          "another type or size");
  for (unsigned y = 0; y < image->height; ++y) {
    for (unsigned x = 0; x < image->width; ++x) {
      require(depth.at<std::uint16_t>(y, x) == plainDepth(*image, x, y, invalid_values), "another depth");
    }
  }
  Camera camera;
  camera.size = {input.below(3), input.below(3)};
  accepts([&] { requireSize(depth, camera, "/depth", "/camera_info"); });
}

std::string seedOf(Encoding encoding, int width, int height, int padding,
                   const std::vector<int>& invalid_values, const std::string& data) {
  Seed seed;
  const int pixel_bytes = encoding == k32FC1 ? 4 : 2;
  putImage(seed, encoding, width, height, width * pixel_bytes + padding);
  seed.below(static_cast<int>(invalid_values.size()));
  for (const int value : invalid_values) seed.put<std::int32_t>(value);
  return seed.rest(data);
}

std::vector<std::string> seeds() {
  std::string metres, millimetres;
  for (int i = 0; i < 70; ++i) {
    Seed metre, millimetre;
    metres += metre.put(i < static_cast<int>(kSpecialNumbers.size()) ? static_cast<float>(kSpecialNumbers[i])
                                                                     : static_cast<float>(i) * 0.9403f);
    millimetres += millimetre.put(static_cast<std::uint16_t>(i * 940));
  }
  return {seedOf(k16UC1, 9, 7, 0, {0, 2047, 65535}, millimetres),
          seedOf(kMono16, 5, 7, 6, {940}, millimetres), seedOf(k32FC1, 9, 7, 0, {2047}, metres),
          seedOf(k32FC1, 5, 7, 8, {}, metres), seedOf(kBgr8, 5, 5, 0, {}, metres)};
}

const FuzzTarget target("depth_message", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
