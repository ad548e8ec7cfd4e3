// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <stdexcept>

#include "conversions.hpp"

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

template <typename T>
sensor_msgs::ImagePtr imageOf(const std::vector<T>& pixels, unsigned width, const std::string& encoding,
                              unsigned padding_bytes = 0) {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->width = width;
  image->height = static_cast<unsigned>(pixels.size()) / width;
  image->encoding = encoding;
  image->step = static_cast<unsigned>(width * sizeof(T)) + padding_bytes;
  image->data.assign(image->step * image->height, 0xab);
  for (unsigned y = 0; y < image->height; ++y) {
    std::memcpy(&image->data[y * image->step], &pixels[y * width], width * sizeof(T));
  }
  return image;
}

std::vector<int> valuesOf(const cv::Mat& mm) {
  return {mm.begin<std::uint16_t>(), mm.end<std::uint16_t>()};
}

// One line that names the place and the fault.
void expectRefused(const std::function<void()>& call, const std::string& word) {
  try {
    call();
    ADD_FAILURE() << "accepted, though wrong: " << word;
  } catch (const std::invalid_argument& e) {
    const std::string text = e.what();
    EXPECT_EQ(text.rfind("/topic: ", 0), 0u) << text;
    EXPECT_NE(text.find(word), std::string::npos) << text;
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
  }
}

sensor_msgs::CameraInfo calibration() {
  sensor_msgs::CameraInfo info;
  info.width = 640, info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {0.1, -0.2, 0.001, 0.002, 0.3};
  info.K = {500, 0, 320, 0, 510, 240, 0, 0, 1};
  return info;
}

TEST(Depth, MillimetresAreShared) {
  for (const std::string& encoding : {enc::TYPE_16UC1, enc::MONO16}) {
    const auto image = imageOf<std::uint16_t>({1, 2, 0, 2046, 2048, 65535}, 3, encoding);
    const cv::Mat depth = toDepth(*image, {0, 2047}, "/topic");
    EXPECT_EQ(depth.data, image->data.data());
    EXPECT_EQ(depth.size(), cv::Size(3, 2));
    EXPECT_EQ(valuesOf(depth), (std::vector<int>{1, 2, 0, 2046, 2048, 65535}));
  }
}

TEST(Depth, InvalidValuesBecomeUnknownInACopy) {
  const auto image = imageOf<std::uint16_t>({2047, 7, 1, 65535, 2046, 2047}, 3, enc::TYPE_16UC1);
  const sensor_msgs::Image before = *image;
  const cv::Mat depth = toDepth(*image, {0, 2047, 65535, -5, 65536 + 7}, "/topic");
  EXPECT_EQ(valuesOf(depth), (std::vector<int>{0, 7, 1, 0, 2046, 0}));
  EXPECT_EQ(image->data, before.data);
  EXPECT_EQ(valuesOf(toDepth(*image, {0}, "/topic"))[0], 2047);
}

TEST(Depth, RowsMayBePadded) {
  const auto image = imageOf<std::uint16_t>({1, 2, 3, 4}, 2, enc::TYPE_16UC1, 6);
  EXPECT_EQ(valuesOf(toDepth(*image, {}, "/topic")), (std::vector<int>{1, 2, 3, 4}));
  EXPECT_EQ(valuesOf(toDepth(*image, {3}, "/topic")), (std::vector<int>{1, 2, 0, 4}));
}

TEST(Depth, MetresAreRoundedAndWhatIsNoDepthIsUnknown) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const auto image = imageOf<float>({1.0f, 1.2344f, 1.2346f, 65.535f, 0.001f, 2.047f,  //
                                     NAN, kInf, -kInf, -1.0f, 65.536f, 1e30f, 0.0f, 0.0004f, -0.0f, 1e-40f},
                                    4, enc::TYPE_32FC1);
  const cv::Mat depth = toDepth(*image, {2047}, "/topic");
  EXPECT_EQ(valuesOf(depth), (std::vector<int>{1000, 1234, 1235, 65535, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(valuesOf(toDepth(*image, {0}, "/topic"))[5], 2047);
}

TEST(Depth, EveryMillimetreSurvivesMetres) {
  std::vector<float> metres(65536);
  for (int mm = 0; mm < 65536; ++mm) metres[mm] = static_cast<float>(mm / 1000.0);
  const std::vector<int> values = valuesOf(toDepth(*imageOf(metres, 256, enc::TYPE_32FC1), {}, "/topic"));
  for (int mm = 0; mm < 65536; ++mm) ASSERT_EQ(values[mm], mm);
}

TEST(Depth, BrokenImagesAreRefusedWithPlaceAndReason) {
  const auto refused = [](const std::function<void(sensor_msgs::Image&)>& spoil, const std::string& word) {
    const auto image = imageOf<std::uint16_t>({1, 2, 3, 4}, 2, enc::TYPE_16UC1);
    spoil(*image);
    expectRefused([&] { toDepth(*image, {2047}, "/topic"); }, word);
  };
  refused([](auto& image) { image.encoding = "bgr8"; }, "bgr8");
  refused([](auto& image) { image.encoding = "16SC1"; }, "16SC1");
  refused([](auto& image) { image.encoding.clear(); }, "encoding");
  refused([](auto& image) { image.width = 0; }, "empty");
  refused([](auto& image) { image.height = 0; }, "empty");
  refused([](auto& image) { image.step = 3; }, "step");
  refused([](auto& image) { image.step = 5; }, "step");
  refused([](auto& image) { image.step = 0; }, "step");
  refused([](auto& image) { image.data.pop_back(); }, "data");
  refused([](auto& image) { image.height = 4294967295u; }, "data");
  refused([](auto& image) { image.width = 4294967295u; }, "step");
  refused([](auto& image) { image.is_bigendian = !image.is_bigendian; }, "endian");
  refused([](auto& image) { image.encoding = "32FC1"; }, "step");
}

TEST(Depth, SizeMustBeTheCalibratedOne) {
  const auto image = imageOf<std::uint16_t>({1, 2}, 2, enc::TYPE_16UC1);
  const cv::Mat depth = toDepth(*image, {}, "/topic");
  Camera camera;
  camera.size = {2, 1};
  EXPECT_NO_THROW(requireSize(depth, camera, "/topic", "/info"));
  camera.size = {1, 2};
  expectRefused([&] { requireSize(depth, camera, "/topic", "/info"); }, "2x1, but /info is for 1x2");
}

TEST(Colour, BecomesBgr) {
  const auto colours = imageOf<std::uint8_t>({10, 20, 30, 40, 50, 60}, 6, enc::RGB8, 2);
  colours->width = 2;
  colours->is_bigendian = 1;  // says nothing of bytes
  EXPECT_EQ(toBgr(colours, "/topic")->image.at<cv::Vec3b>(0, 1), cv::Vec3b(60, 50, 40));
  const auto bgr = imageOf<std::uint8_t>({10, 20, 30}, 3, enc::BGR8);
  bgr->width = 1;
  EXPECT_EQ(toBgr(bgr, "/topic")->image.data, bgr->data.data());
  const auto deep = imageOf<std::uint16_t>({256, 512, 65535}, 3, enc::BGR16);
  deep->width = 1;
  EXPECT_EQ(toBgr(deep, "/topic")->image.at<cv::Vec3w>(0, 0), cv::Vec3w(256, 512, 65535));
  const auto turned = imageOf<std::uint16_t>({1, 2, 3}, 3, enc::RGB16);
  turned->width = 1;
  EXPECT_EQ(toBgr(turned, "/topic")->image.at<cv::Vec3w>(0, 0), cv::Vec3w(3, 2, 1));
  const auto gray = imageOf<std::uint16_t>({4095}, 1, enc::MONO16);
  EXPECT_EQ(toBgr(gray, "/topic")->image.at<cv::Vec3w>(0, 0), cv::Vec3w(4095, 4095, 4095));
}

TEST(Colour, BrokenImagesAreRefusedWithPlaceAndReason) {
  const auto refused = [](const std::function<void(sensor_msgs::Image&)>& spoil, const std::string& word) {
    const auto image = imageOf<std::uint16_t>({1, 2, 3, 4, 5, 6}, 6, enc::BGR16);
    image->width = 2;
    spoil(*image);
    expectRefused([&] { toBgr(image, "/topic"); }, word);
  };
  refused([](auto& image) { image.is_bigendian = !image.is_bigendian; }, "endian");
  refused([](auto& image) { image.encoding = "what"; }, "no colour can be made of encoding \"what\"");
  refused([](auto& image) { image.encoding = enc::TYPE_16UC2; },
          "no colour can be made of encoding \"16UC2\"");
  refused([](auto& image) { image.height = 0; }, "empty");
  refused(
      [](auto& image) {
        image.encoding = enc::YUV422;
        image.width = 3;
      },
      "yuv422 tells pairs of pixels, but the width is 3");
  refused([](auto& image) { image.step = 10; }, "step");
  refused([](auto& image) { image.data.pop_back(); }, "data");
}

TEST(Camera, TakesIntrinsicsAndDistortion) {
  const Camera camera = toCamera(calibration(), "/topic");
  EXPECT_EQ(camera.size, cv::Size(640, 480));
  EXPECT_EQ(cv::Vec4d(camera.fx, camera.fy, camera.cx, camera.cy), cv::Vec4d(500, 510, 320, 240));
  EXPECT_EQ(camera.distortion, (std::array<double, 8>{0.1, -0.2, 0.001, 0.002, 0.3, 0, 0, 0}));
}

TEST(Camera, DistortionModels) {
  sensor_msgs::CameraInfo info = calibration();
  info.distortion_model = "rational_polynomial";
  info.D = {1, 2, 3, 4, 5, 6, 7, 8};
  EXPECT_EQ(toCamera(info, "/topic").distortion, (std::array<double, 8>{1, 2, 3, 4, 5, 6, 7, 8}));
  info.K[1] = 3;
  expectRefused([&] { toCamera(info, "/topic"); }, "has a skew, 3");
  info.K[1] = 0;
  info.D = {1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 0};
  EXPECT_EQ(toCamera(info, "/topic").distortion[7], 8);
  info.D.back() = 0.1;
  expectRefused([&] { toCamera(info, "/topic"); }, "8 distortion coefficients, not 12");
  info.D.clear();
  EXPECT_FALSE(toCamera(info, "/topic").distorted());
  info.distortion_model.clear();
  EXPECT_FALSE(toCamera(info, "/topic").distorted());
  info.distortion_model = "plumb_bob";
  info.D.assign(8, 0.0);  // as many drivers publish
  EXPECT_FALSE(toCamera(info, "/topic").distorted());
  info.distortion_model = "omni";
  expectRefused([&] { toCamera(info, "/topic"); }, "\"omni\"");
}

TEST(Camera, ImpossibleCalibrationsAreRefused) {
  const auto refused = [](const std::function<void(sensor_msgs::CameraInfo&)>& spoil,
                          const std::string& word) {
    sensor_msgs::CameraInfo info = calibration();
    spoil(info);
    expectRefused([&] { toCamera(info, "/topic"); }, word);
  };
  refused([](auto& info) { info.K.fill(0); }, "not calibrated");
  refused([](auto& info) { info.K[0] = NAN; }, "not calibrated");
  refused([](auto& info) { info.K[4] = -1; }, "not calibrated");
  refused([](auto& info) { info.K[0] = INFINITY; }, "impossible");
  refused([](auto& info) { info.K[0] = info.K[4] = 1e-3; }, "fx = 0.001, fy = 0.001");
  refused([](auto& info) { info.K[4] = 1e8; }, "fy = 1e+08");
  refused([](auto& info) { info.K[2] = NAN; }, "impossible");
  refused([](auto& info) { info.K[5] = -1e161; }, "principal point is 320, -1e+161");
  refused([](auto& info) { info.D[1] = NAN; }, "impossible");
  refused([](auto& info) { info.D[1] = 1e7; }, "a distortion coefficient is 1e+07");
  refused([](auto& info) { info.width = 0; }, "0x480");
  refused([](auto& info) { info.height = 4000000000u; }, "640x4000000000");
  refused([](auto& info) { info.binning_x = 1000; }, "0x480");
  refused([](auto& info) { info.width = info.height = 20000; }, "100 megapixels");
  refused([](auto& info) { info.roi.width = info.roi.height = 46000; }, "region of interest (46000x46000");
  refused([](auto& info) { info.roi.width = 10, info.roi.x_offset = 4294967295u; }, "region of interest");
  refused([](auto& info) { info.binning_y = 4294967295u; }, "640x0");
}

TEST(Camera, ARegionOfInterestIsThatOfTheImages) {
  sensor_msgs::CameraInfo info = calibration();
  EXPECT_NO_THROW(requireRegion(info, {320, 240}, "/topic"));  // another resolution
  info.roi.width = 320, info.roi.height = 240, info.roi.x_offset = 100;
  EXPECT_NO_THROW(requireRegion(info, {320, 240}, "/topic"));
  expectRefused(
      [&] {
        requireRegion(info, {640, 480}, "/topic");
      },
      "region of interest gives images of 320x240, but they have 640x480");
  info.binning_x = info.binning_y = 2;
  EXPECT_NO_THROW(requireRegion(info, {160, 120}, "/topic"));
  info.roi.width = 640, info.roi.height = 480, info.roi.x_offset = 0;
  EXPECT_NO_THROW(requireRegion(info, {640, 480}, "/topic"));  // the whole sensor
}

TEST(Camera, BinningAndRegionOfInterestAreApplied) {
  sensor_msgs::CameraInfo info = calibration();
  info.binning_x = 2, info.binning_y = 4;
  info.roi.x_offset = 100, info.roi.y_offset = 40;
  info.roi.width = 200, info.roi.height = 400;
  const Camera camera = toCamera(info, "/topic");
  EXPECT_EQ(camera.size, cv::Size(100, 100));
  EXPECT_DOUBLE_EQ(camera.fx, 250);
  EXPECT_DOUBLE_EQ(camera.fy, 127.5);
  // A point of the full image and the binned pixel that covers it: full 160..161 is binned 30.
  const auto binned = [&](double full_x) { return (full_x - 320) / 500 * camera.fx + camera.cx; };
  EXPECT_NEAR(binned(160.5), 30, 1e-9);
  EXPECT_DOUBLE_EQ(camera.cy, (240 - 40 + 0.5) / 4 - 0.5);
}

TEST(OpticsMessage, ThereAndBack) {
  const core::Optics optics{50, 1.8, 0.03};
  EXPECT_TRUE(toOptics(toMessage(optics)) == optics);
  OpticsMsg wrong = toMessage(optics);
  wrong.aperture = 0;
  EXPECT_THROW(toOptics(wrong), std::invalid_argument);
  for (const DofSpan span : {DofSpan::kPaper, DofSpan::kFull}) EXPECT_EQ(parseDofSpan(name(span)), span);
  EXPECT_THROW(parseDofSpan(""), std::invalid_argument);
}

TEST(Segments, AreInMetres) {
  SegmentationConfig config;
  config.span = DofSpan::kFull;
  Segmentation segmentation;
  segmentation.unknown_area = 5;
  segmentation.segments.assign(2, {1, 10, 1000, 1500, 1200, true});
  const SegmentArrayPtr array = toMessage(segmentation, config);
  EXPECT_EQ(array->dof_rule, "full");
  EXPECT_EQ(array->optics.focal_length_mm, config.optics.focal_length_mm);
  EXPECT_EQ(array->unknown_area, 5u);
  ASSERT_EQ(array->segments.size(), 2u);
  const SegmentMsg& message = array->segments[0];
  EXPECT_EQ(message.label, 1u);
  EXPECT_EQ(message.area, 10u);
  EXPECT_DOUBLE_EQ(message.depth_min, 1.0);
  EXPECT_DOUBLE_EQ(message.depth_max, 1.5);
  EXPECT_DOUBLE_EQ(message.depth_median, 1.2);
  EXPECT_DOUBLE_EQ(message.diff, 0.5);
  EXPECT_DOUBLE_EQ(message.focus_distance, 1.2);
  EXPECT_DOUBLE_EQ(message.max_dof, maxDof(config.optics, 1000, 1500) / 1000);
  EXPECT_TRUE(message.fits);
}

}  // namespace
}  // namespace all_in_focus
