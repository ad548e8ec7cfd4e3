// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Images of OpenNI2 drivers, which may be broken, as messages.

#include "conversions.hpp"
#include "kinect_calibration.hpp"
#include "kinect_frame.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

const openni::PixelFormat kFormats[] = {
    openni::PIXEL_FORMAT_DEPTH_1_MM, openni::PIXEL_FORMAT_DEPTH_100_UM, openni::PIXEL_FORMAT_SHIFT_9_2,
    openni::PIXEL_FORMAT_RGB888,     openni::PIXEL_FORMAT_YUV422,       openni::PIXEL_FORMAT_GRAY8,
    openni::PIXEL_FORMAT_GRAY16,     openni::PIXEL_FORMAT_JPEG,         openni::PIXEL_FORMAT_YUYV};

int sideFrom(Input& input) {
  return input.flag() ? input.take<std::uint8_t>() : input.take<std::int32_t>();
}

void run(Input& input) {
  KinectFrame frame;
  frame.stream = kKinectStreams[input.below(std::size(kKinectStreams))];
  frame.format = kFormats[input.below(std::size(kFormats))];
  frame.width = sideFrom(input);
  frame.height = sideFrom(input);
  frame.stride = sideFrom(input);
  const bool fits = input.flag();
  frame.mode.width = fits ? frame.width : sideFrom(input);
  frame.mode.height = fits ? frame.height : sideFrom(input);
  frame.mode.mirrored = input.flag();
  frame.mode.horizontal_fov = input.number();
  const int invalid = input.take<std::int32_t>();
  const std::string rest = input.rest();
  const std::vector<char> data(rest.begin(), rest.end());  // its end is guarded, that of a short text is not
  frame.data = data.empty() ? nullptr : data.data();
  frame.bytes = data.size();

  sensor_msgs::ImagePtr image;
  if (!accepts([&] { image = toImage(frame, {}, {0, invalid}); })) return;
  require(static_cast<int>(image->width) == frame.width && static_cast<int>(image->height) == frame.height,
          "another size");
  require(image->data.size() == static_cast<std::size_t>(image->step) * image->height, "too few bytes");
  accepts([&] { toCamera(cameraInfoOf(frame.stream, frame.mode), "/camera_info"); });
  if (frame.format != openni::PIXEL_FORMAT_DEPTH_1_MM) return;
  const cv::Mat depth = toDepth(*image, {}, "/depth");
  for (int y = 0; y < frame.height; ++y) {
    for (int x = 0; x < frame.width; ++x) {
      std::uint16_t mm = 0;
      const int from = frame.mode.mirrored ? frame.width - 1 - x : x;
      std::memcpy(&mm, &data[static_cast<std::size_t>(y) * frame.stride + from * sizeof mm], sizeof mm);
      require(depth.at<std::uint16_t>(y, x) == (mm == invalid ? 0 : mm), "another depth");
    }
  }
}

std::string seedOf(KinectStream stream, int format, int pixel_bytes, bool mirrored) {
  constexpr int kWidth = 6, kHeight = 5, kPadding = 4;
  const int stride = kWidth * pixel_bytes + kPadding;
  std::string data;
  for (int i = 0; i < stride * kHeight; ++i) data += static_cast<char>(i * 37);
  Seed seed;
  seed.below(static_cast<int>(indexOf(stream))).below(format);
  for (const int side : {kWidth, kHeight, stride}) seed.flag(true).below(side);
  return seed.flag(true).flag(mirrored).number(1.02).put<std::int32_t>(0x2500).rest(data);
}

std::vector<std::string> seeds() {
  return {seedOf(KinectStream::kDepth, 0, 2, false), seedOf(KinectStream::kDepth, 0, 2, true),
          seedOf(KinectStream::kDepth, 1, 2, false), seedOf(KinectStream::kColor, 3, 3, true),
          seedOf(KinectStream::kColor, 4, 2, false), seedOf(KinectStream::kIr, 5, 1, false),
          seedOf(KinectStream::kIr, 6, 2, true)};
}

const FuzzTarget target("kinect_frame", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
