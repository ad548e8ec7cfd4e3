// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Image messages as colour pictures.

#include "conversions.hpp"
#include "image_messages.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

void requirePixels(const sensor_msgs::Image& image, const cv::Mat& picture) {
  const bool is_bgr = image.encoding == kEncodings[kBgr8], is_rgb = image.encoding == kEncodings[kRgb8];
  for (int y = 0; (is_bgr || is_rgb) && y < picture.rows; ++y) {
    for (int i = 0; i < 3 * picture.cols; ++i) {
      const int from = is_bgr ? i : i - i % 3 + (2 - i % 3);
      require(picture.ptr(y)[i] == image.data[static_cast<std::size_t>(y) * image.step + from],
              "another pixel");
    }
  }
}

void run(Input& input) {
  const sensor_msgs::ImagePtr image = imageFrom(input);
  const std::string data = input.rest();
  image->data.assign(data.begin(), data.end());
  const sensor_msgs::Image before = *image;
  cv_bridge::CvImageConstPtr picture;
  if (!accepts([&] { picture = toBgr(image, "/image"); })) return;
  require(image->data == before.data, "the message has changed");
  const int type = picture->image.type();
  require((type == CV_8UC3 || type == CV_16UC3) &&
              static_cast<unsigned>(picture->image.cols) == image->width &&
              static_cast<unsigned>(picture->image.rows) == image->height,
          "another type or size");
  requirePixels(*image, picture->image);
}

std::vector<std::string> seeds() {
  std::string data;
  for (int i = 0; i < 8 * 9 * 7; ++i) data += static_cast<char>(i * 37);
  std::vector<std::string> seeds;
  for (const auto& [encoding, pixel_bytes] : {std::pair(kBgr8, 3),
                                              {kRgb8, 3},
                                              {kMono8, 1},
                                              {kBgra8, 4},
                                              {kRgb16, 6},
                                              {kMono16, 2},
                                              {kBayer8, 1},
                                              {kBayer16, 2},
                                              {kYuv422, 2},
                                              {k8UC3, 3},
                                              {k32FC1, 4}}) {
    for (const int padding : {0, 4}) {
      Seed seed;
      seeds.push_back(putImage(seed, encoding, 8, 7, 8 * pixel_bytes + padding).rest(data));
    }
  }
  for (const char* encoding : {"8UC0", "8UC-3", "8UC99", "16SC"}) {
    Seed seed;
    seed.below(std::size(kEncodings))
        .text(encoding)
        .flag(false)
        .below(2)
        .below(2)
        .put<std::uint16_t>(6)
        .flag(false);
    seeds.push_back(seed.rest(data));
  }
  return seeds;
}

const FuzzTarget target("color_message", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
