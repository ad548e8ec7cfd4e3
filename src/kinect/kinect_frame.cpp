// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_frame.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

struct Layout {
  openni::PixelFormat format;
  bool is_depth;
  int cv_type;                  // of the camera's pixels
  const std::string& encoding;  // of the message
};

const Layout kLayouts[] = {{openni::PIXEL_FORMAT_DEPTH_1_MM, true, CV_16UC1, enc::TYPE_16UC1},
                           {openni::PIXEL_FORMAT_DEPTH_100_UM, true, CV_16UC1, enc::TYPE_16UC1},
                           {openni::PIXEL_FORMAT_GRAY8, false, CV_8UC1, enc::MONO8},
                           {openni::PIXEL_FORMAT_GRAY16, false, CV_16UC1, enc::MONO16},
                           {openni::PIXEL_FORMAT_RGB888, false, CV_8UC3, enc::RGB8},
                           {openni::PIXEL_FORMAT_YUV422, false, CV_8UC2, enc::RGB8}};

const Layout& layoutOf(openni::PixelFormat format, KinectStream stream) {
  for (const Layout& layout : kLayouts) {
    if (layout.format == format && layout.is_depth == (stream == KinectStream::kDepth)) return layout;
  }
  throw std::invalid_argument("its pixel format " + std::to_string(format) + " is not supported");
}

void requireWhole(const KinectFrame& frame, int cv_type) {
  if (frame.width != frame.mode.width || frame.height != frame.mode.height) {
    throw std::invalid_argument(cv::format("it has %dx%d pixels, the stream was set to %dx%d", frame.width,
                                           frame.height, frame.mode.width, frame.mode.height));
  }
  if (frame.width <= 0 || frame.height <= 0 || frame.data == nullptr) {
    throw std::invalid_argument("it has no pixels");
  }
  // OpenCV writes pairs of pixels, the last one beyond the end of the picture.
  if (frame.format == openni::PIXEL_FORMAT_YUV422 && frame.width % 2 != 0)
    throw std::invalid_argument(cv::format("YUV422 tells pairs of pixels, but its width is %d", frame.width));
  const std::size_t stride = frame.stride,
                    row = static_cast<std::size_t>(frame.width) * CV_ELEM_SIZE(cv_type);
  if (frame.stride < 0 || stride < row || stride % CV_ELEM_SIZE1(cv_type) != 0) {
    throw std::invalid_argument(cv::format("rows of %zu bytes cannot be %d bytes apart", row, frame.stride));
  }
  const std::size_t needed = stride * (frame.height - 1) + row;
  if (frame.bytes < needed)
    throw std::invalid_argument(cv::format("%zu bytes are needed, %zu came", needed, frame.bytes));
}

}  // namespace

const char* toString(KinectStream stream) {
  constexpr const char* kNames[] = {"depth", "IR", "colour"};
  return kNames[indexOf(stream)];
}

sensor_msgs::ImagePtr toImage(const KinectFrame& frame, const std_msgs::Header& header,
                              const std::vector<int>& invalid_values) {
  const Layout& layout = layoutOf(frame.format, frame.stream);
  requireWhole(frame, layout.cv_type);

  const cv::Mat camera(frame.height, frame.width, layout.cv_type, const_cast<void*>(frame.data),
                       frame.stride);
  cv::Mat image;
  if (frame.format == openni::PIXEL_FORMAT_YUV422) {
    cv::cvtColor(camera, image, cv::COLOR_YUV2RGB_UYVY);
  } else if (frame.format == openni::PIXEL_FORMAT_DEPTH_100_UM) {
    camera.convertTo(image, CV_16U, 0.1);
  } else {
    image = camera.clone();
  }
  if (frame.mode.mirrored) cv::flip(image, image, 1);
  for (const int value : invalid_values) {
    if (layout.is_depth) image.setTo(0, image == value);
  }
  return cv_bridge::CvImage(header, layout.encoding, image).toImageMsg();
}

}  // namespace all_in_focus
