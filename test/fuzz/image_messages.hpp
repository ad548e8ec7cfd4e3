// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>

#include "input.hpp"

namespace all_in_focus::fuzz {

enum Encoding {
  k16UC1,
  kMono16,
  k32FC1,
  kBgr8,
  kRgb8,
  kMono8,
  kBgra8,
  kRgb16,
  kBayer8,
  kBayer16,
  kYuv422,
  k8UC3
};
const std::string kEncodings[] = {
    sensor_msgs::image_encodings::TYPE_16UC1,  sensor_msgs::image_encodings::MONO16,
    sensor_msgs::image_encodings::TYPE_32FC1,  sensor_msgs::image_encodings::BGR8,
    sensor_msgs::image_encodings::RGB8,        sensor_msgs::image_encodings::MONO8,
    sensor_msgs::image_encodings::BGRA8,       sensor_msgs::image_encodings::RGB16,
    sensor_msgs::image_encodings::BAYER_RGGB8, sensor_msgs::image_encodings::BAYER_GRBG16,
    sensor_msgs::image_encodings::YUV422,      sensor_msgs::image_encodings::TYPE_8UC3};

/// Any image message, without its data.
inline sensor_msgs::ImagePtr imageFrom(Input& input) {
  auto image = boost::make_shared<sensor_msgs::Image>();
  const std::size_t encoding = input.below(static_cast<int>(std::size(kEncodings)) + 1);
  image->encoding = encoding < std::size(kEncodings) ? kEncodings[encoding] : input.text(20);
  const bool is_any = input.flag();
  image->width = is_any ? input.take<std::uint32_t>() : input.take<std::uint8_t>();
  image->height = is_any ? input.take<std::uint32_t>() : input.take<std::uint8_t>();
  image->step = is_any ? input.take<std::uint32_t>() : input.take<std::uint16_t>();
  image->is_bigendian = input.flag();
  return image;
}

inline Seed& putImage(Seed& seed, Encoding encoding, int width, int height, int step) {
  seed.below(encoding).flag(false).below(width).below(height);
  return seed.put(static_cast<std::uint16_t>(step)).flag(false);
}

}  // namespace all_in_focus::fuzz
