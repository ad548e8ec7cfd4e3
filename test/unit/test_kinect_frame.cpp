// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "kinect_calibration.hpp"
#include "kinect_frame.hpp"

namespace all_in_focus {
namespace {

using Bytes = std::vector<std::uint8_t>;

KinectFrame frameOf(KinectStream stream, openni::PixelFormat format, int width, int height,
                    const Bytes& data) {
  const int stride = static_cast<int>(data.size()) / height;
  return {stream, {width, height}, 0, 0, format, width, height, stride, data.data(), data.size()};
}

Bytes bytesOf(const std::vector<std::uint16_t>& values) {
  Bytes bytes(values.size() * 2);
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

std::vector<std::uint16_t> valuesOf(const sensor_msgs::Image& image) {
  std::vector<std::uint16_t> values(image.data.size() / 2);
  std::memcpy(values.data(), image.data.data(), image.data.size());
  return values;
}

TEST(KinectFrame, DepthWithoutInvalidValuesAndGaps) {
  const Bytes data = bytesOf({1, 2047, 3, 99, 4, 5, 2047, 99});  // 3 pixels a row, and a gap of one
  KinectFrame frame = frameOf(KinectStream::kDepth, openni::PIXEL_FORMAT_DEPTH_1_MM, 3, 2, data);
  frame.bytes -= 2;  // no gap after the last row
  std_msgs::Header header;
  header.frame_id = "depth";
  const sensor_msgs::ImagePtr image = toImage(frame, header, {0, 2047});
  EXPECT_EQ(image->encoding, "16UC1");
  EXPECT_EQ(image->header.frame_id, "depth");
  EXPECT_EQ(image->step, 6U);
  EXPECT_EQ(valuesOf(*image), (std::vector<std::uint16_t>{1, 0, 3, 4, 5, 0}));
  EXPECT_EQ(valuesOf(*toImage(frame, header, {})), (std::vector<std::uint16_t>{1, 2047, 3, 4, 5, 2047}));
  EXPECT_EQ(valuesOf(*toImage(frame, header, {-1, 65536 + 3, 5})),
            (std::vector<std::uint16_t>{1, 2047, 3, 4, 0, 2047}));
}

TEST(KinectFrame, MirroredImagesAreTurned) {
  const Bytes data = bytesOf({1, 2, 3, 4, 5, 6});
  KinectFrame frame = frameOf(KinectStream::kDepth, openni::PIXEL_FORMAT_DEPTH_1_MM, 3, 2, data);
  frame.mode.mirrored = true;
  EXPECT_EQ(valuesOf(*toImage(frame, {}, {})), (std::vector<std::uint16_t>{3, 2, 1, 6, 5, 4}));
}

TEST(KinectFrame, TenthsOfAMillimetre) {
  const Bytes data = bytesOf({0, 14, 16, 65535});
  const KinectFrame frame = frameOf(KinectStream::kDepth, openni::PIXEL_FORMAT_DEPTH_100_UM, 2, 2, data);
  EXPECT_EQ(valuesOf(*toImage(frame, {}, {})), (std::vector<std::uint16_t>{0, 1, 2, 6554}));
}

TEST(KinectFrame, InfraredAndColour) {
  const Bytes data = bytesOf({2047, 2, 3, 4});
  const auto ir = toImage(frameOf(KinectStream::kIr, openni::PIXEL_FORMAT_GRAY16, 2, 2, data), {}, {2047});
  EXPECT_EQ(ir->encoding, "mono16");
  EXPECT_EQ(valuesOf(*ir)[0], 2047);  // no depth
  EXPECT_EQ(toImage(frameOf(KinectStream::kIr, openni::PIXEL_FORMAT_GRAY8, 4, 2, data), {}, {})->encoding,
            "mono8");

  const Bytes rgb{1, 2, 3, 4, 5, 6};
  const auto colour = toImage(frameOf(KinectStream::kColor, openni::PIXEL_FORMAT_RGB888, 2, 1, rgb), {}, {});
  EXPECT_EQ(colour->encoding, "rgb8");
  EXPECT_EQ(colour->data, rgb);
  const Bytes grey{128, 126, 128, 126};  // u y v y
  const auto yuv = toImage(frameOf(KinectStream::kColor, openni::PIXEL_FORMAT_YUV422, 2, 1, grey), {}, {});
  EXPECT_EQ(yuv->encoding, "rgb8");
  EXPECT_EQ(yuv->step, 6U);
  for (const int value : yuv->data) EXPECT_NEAR(value, 128, 1);
}

TEST(KinectFrame, BrokenOnesAreRefusedByName) {
  const Bytes data(12);
  const auto refusal = [&](const std::function<void(KinectFrame&)>& spoil) {
    KinectFrame frame = frameOf(KinectStream::kDepth, openni::PIXEL_FORMAT_DEPTH_1_MM, 3, 2, data);
    spoil(frame);
    try {
      toImage(frame, {}, {});
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string("accepted");
  };
  EXPECT_EQ(refusal([](KinectFrame&) {}), "accepted");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.bytes = 11; }), "12 bytes are needed, 11 came");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.stride = 5; }), "rows of 6 bytes cannot be 5 bytes apart");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.height = f.mode.height = 1, f.stride = 7; }),
            "rows of 6 bytes cannot be 7 bytes apart");  // the second would begin amid a pixel
  EXPECT_EQ(refusal([](KinectFrame& f) { f.stride = -6; }), "rows of 6 bytes cannot be -6 bytes apart");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.stride = std::numeric_limits<int>::max() - 1; }),
            "2147483652 bytes are needed, 12 came");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.width = 4; }), "it has 4x2 pixels, the stream was set to 3x2");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.width = f.mode.width = -3; }), "it has no pixels");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.data = nullptr; }), "it has no pixels");
  EXPECT_EQ(refusal([](KinectFrame& f) {
              f.stream = KinectStream::kColor;
              f.format = openni::PIXEL_FORMAT_YUV422;
            }),
            "YUV422 tells pairs of pixels, but its width is 3");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.format = openni::PIXEL_FORMAT_SHIFT_9_2; }),
            "its pixel format 102 is not supported");
  EXPECT_EQ(refusal([](KinectFrame& f) { f.format = openni::PIXEL_FORMAT_RGB888; }),
            "its pixel format 200 is not supported");
}

TEST(KinectCalibration, PinholeOfTheFieldOfView) {
  KinectMode mode{640, 480, 30, M_PI / 2};
  const auto info = cameraInfoOf(KinectStream::kDepth, mode);
  EXPECT_NEAR(info.K[0], 320, 1e-9);
  EXPECT_EQ(info.K[0], info.K[4]);
  EXPECT_EQ(info.P[5], info.K[4]);
  EXPECT_EQ(info.K[2], 319.5);
  EXPECT_EQ(info.K[5], 239.5);
  EXPECT_EQ(info.distortion_model, "plumb_bob");
  for (const double fov : {0.0, -1.0, 4.0, std::nan("")}) {  // not told, or nonsense
    mode.horizontal_fov = fov;
    EXPECT_NEAR(cameraInfoOf(KinectStream::kDepth, mode).K[0], 571.4, 0.1);
    EXPECT_NEAR(cameraInfoOf(KinectStream::kColor, mode).K[0], 532.6, 0.1);
  }
}

}  // namespace
}  // namespace all_in_focus
