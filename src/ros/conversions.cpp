// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "conversions.hpp"

#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstdint>
#include <stdexcept>

#include "all_in_focus/scene_points.hpp"

namespace all_in_focus {
namespace {

namespace enc = sensor_msgs::image_encodings;

constexpr unsigned kMaxSize = 32767;  // pixels, width or height of a camera
constexpr std::uint64_t kMaxPixels = 100000000;
constexpr bool kIsBigEndian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;

[[noreturn]] void fail(const std::string& topic, const std::string& what) {
  throw std::invalid_argument(topic + ": " + what);
}

// Checks what a cv::Mat over the message's memory needs. The encoding must be a known one.
void checkLayout(const sensor_msgs::Image& image, const std::string& topic) {
  const char* encoding = image.encoding.c_str();
  const auto value_bytes = static_cast<std::size_t>(enc::bitDepth(image.encoding)) / 8;  // of a channel
  const auto channels = static_cast<std::size_t>(enc::numChannels(image.encoding));
  if (image.width == 0 || image.height == 0)
    fail(topic, cv::format("the image is empty (%ux%u): check its publisher", image.width, image.height));
  const std::size_t row_bytes = image.width * value_bytes * channels;
  if (image.step < row_bytes || image.step % value_bytes != 0) {
    fail(topic, cv::format("step is %u bytes, but a row of %u %s pixels has %zu: check its publisher",
                           image.step, image.width, encoding, row_bytes));
  }
  const std::size_t bytes = static_cast<std::size_t>(image.step) * image.height;
  if (image.data.size() < bytes) {
    fail(topic, cv::format("data holds %zu bytes, but %ux%u %s needs %zu: check its publisher",
                           image.data.size(), image.width, image.height, encoding, bytes));
  }
  // OpenCV writes pairs of pixels, the last one beyond the end of the picture.
  if (image.encoding.rfind("yuv", 0) == 0 && image.width % 2 != 0) {
    fail(topic, cv::format("%s tells pairs of pixels, but the width is %u: check its publisher", encoding,
                           image.width));
  }
  if (value_bytes > 1 && (image.is_bigendian != 0) != kIsBigEndian) {
    fail(topic, cv::format("the image is %s-endian, this computer is not: publish it in host byte order",
                           image.is_bigendian ? "big" : "little"));
  }
}

// A view of the message's memory. Do not write to it.
cv::Mat wrap(const sensor_msgs::Image& image, int type) {
  return cv::Mat(static_cast<int>(image.height), static_cast<int>(image.width), type,
                 const_cast<std::uint8_t*>(image.data.data()), image.step);
}

// Comparisons with NaN are false: it becomes 0 like all that is out of range.
cv::Mat metresToMm(const cv::Mat& m) {
  cv::Mat mm(m.size(), CV_16UC1);
  for (int y = 0; y < m.rows; ++y) {
    std::transform(m.ptr<float>(y), m.ptr<float>(y) + m.cols, mm.ptr<std::uint16_t>(y), [](float metres) {
      const float rounded = metres * static_cast<float>(kMmPerM) + 0.5f;
      const float valid = rounded >= 1.0f && rounded < 65536.0f ? rounded : 0.0f;
      return static_cast<std::uint16_t>(static_cast<std::int32_t>(valid));
    });
  }
  return mm;
}

}  // namespace

cv::Mat toDepth(const sensor_msgs::Image& message, const std::vector<int>& invalid_values,
                const std::string& topic) {
  const bool millimetres = message.encoding == enc::TYPE_16UC1 || message.encoding == enc::MONO16;
  if (!millimetres && message.encoding != enc::TYPE_32FC1) {
    fail(topic, "depth has encoding \"" + message.encoding +
                    "\": publish 16UC1 (millimetres) or 32FC1 (metres), or remap the topic");
  }
  checkLayout(message, topic);

  cv::Mat mm = millimetres ? wrap(message, CV_16UC1) : metresToMm(wrap(message, CV_32FC1));
  bool shared = millimetres;
  for (const int value : invalid_values) {
    const cv::Mat invalid = mm == value;
    if (value == 0 || cv::countNonZero(invalid) == 0) continue;
    if (shared) mm = mm.clone();
    shared = false;
    mm.setTo(0, invalid);
  }
  return mm;
}

cv_bridge::CvImageConstPtr toBgr(const sensor_msgs::ImageConstPtr& image, const std::string& topic) {
  try {
    checkLayout(*image, topic);
    return cv_bridge::toCvShare(image, enc::bitDepth(image->encoding) == 16 ? enc::BGR16 : enc::BGR8);
  } catch (const std::runtime_error&) {  // sensor_msgs or cv_bridge does not know it
  } catch (const cv::Exception&) {
  }
  fail(topic, "no colour can be made of encoding \"" + image->encoding +
                  "\": publish bgr8 or rgb8, or remap the topic");
}

void requireSize(const cv::Mat& depth, const Camera& camera, const std::string& topic,
                 const std::string& info_topic) {
  if (depth.size() == camera.size) return;
  fail(topic, cv::format("depth is %dx%d, but %s is for %dx%d: use the calibration of this resolution",
                         depth.cols, depth.rows, info_topic.c_str(), camera.size.width, camera.size.height));
}

sensor_msgs::ImagePtr blankImage(const std_msgs::Header& header, const std::string& encoding,
                                 const cv::Size& size, cv::Mat& pixels) {
  const int type = cv_bridge::getCvType(encoding);
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header = header;
  message->encoding = encoding;
  message->height = static_cast<std::uint32_t>(size.height);
  message->width = static_cast<std::uint32_t>(size.width);
  message->step = message->width * static_cast<std::uint32_t>(CV_ELEM_SIZE(type));
  message->data.resize(std::size_t{message->step} * message->height);
  pixels = cv::Mat(size, type, message->data.data(), message->step);
  return message;
}

Camera toCamera(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  if (std::max(info.width, info.height) > kMaxSize || std::uint64_t{info.width} * info.height > kMaxPixels) {
    fail(topic,
         cv::format("image size is %ux%u, more than 100 megapixels or %u in a row: check width and height",
                    info.width, info.height, kMaxSize));
  }
  const sensor_msgs::RegionOfInterest& roi = info.roi;
  if (std::uint64_t{roi.x_offset} + roi.width > info.width ||
      std::uint64_t{roi.y_offset} + roi.height > info.height) {
    fail(topic, cv::format("the region of interest (%ux%u at %u, %u) is not inside the image of %ux%u",
                           roi.width, roi.height, roi.x_offset, roi.y_offset, info.width, info.height));
  }
  const bool is_whole = roi.width == 0 || roi.height == 0;
  const unsigned width = is_whole ? info.width : roi.width, height = is_whole ? info.height : roi.height;
  const unsigned bin_x = std::max(1u, info.binning_x), bin_y = std::max(1u, info.binning_y);
  if (!(info.K[0] > 0 && info.K[4] > 0)) {
    fail(topic, cv::format("the camera is not calibrated (fx = %g, fy = %g): calibrate it, or give its "
                           "driver a calibration file",
                           info.K[0], info.K[4]));
  }
  Camera camera;
  try {
    camera.setMatrix(info.K.data());
    camera.setDistortion(info.distortion_model, info.D);
    // K is that of the full sensor; the images hold its region of interest, binned.
    camera.size = cv::Size(static_cast<int>(width / bin_x), static_cast<int>(height / bin_y));
    camera.fx /= bin_x;
    camera.fy /= bin_y;
    // Pixel centres are integers, so a binned pixel's centre lies half a bin inside.
    camera.cx = (camera.cx - static_cast<double>(roi.x_offset) + 0.5) / bin_x - 0.5;
    camera.cy = (camera.cy - static_cast<double>(roi.y_offset) + 0.5) / bin_y - 0.5;
    validate(camera, "impossible calibration of the");
  } catch (const std::invalid_argument& e) {
    fail(topic, e.what());
  }
  return camera;
}

void requireRegion(const sensor_msgs::CameraInfo& info, const cv::Size& image, const std::string& topic) {
  const sensor_msgs::RegionOfInterest& roi = info.roi;
  const bool is_whole =
      roi.width == 0 || roi.height == 0 || (roi.width == info.width && roi.height == info.height);
  if (is_whole) return;
  const cv::Size size = toCamera(info, topic).size;
  if (image == size) return;
  fail(topic, cv::format("its region of interest gives images of %dx%d, but they have %dx%d: publish the "
                         "region that they show, or none",
                         size.width, size.height, image.width, image.height));
}

sensor_msgs::PointCloud2Ptr toPointCloud(const std_msgs::Header& header, const cv::Mat& bgr,
                                         const cv::Mat& mm, const core::Camera& camera) {
  if (bgr.type() != CV_8UC3 || mm.type() != CV_16UC1 || bgr.size() != mm.size())
    throw std::invalid_argument("a cloud needs a colour picture and depth of its size");
  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  cloud->width = static_cast<std::uint32_t>(bgr.cols);
  cloud->height = static_cast<std::uint32_t>(bgr.rows);
  cloud->is_dense = 0;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2FieldsByString(2, "xyz", "rgb");
  cv::parallel_for_({0, bgr.rows}, [&](const cv::Range& rows) {
    sensor_msgs::PointCloud2Iterator<float> place(*cloud, "x");
    sensor_msgs::PointCloud2Iterator<std::uint8_t> color(*cloud, "b");
    place += rows.start * bgr.cols;
    color += rows.start * bgr.cols;
    std::vector<cv::Vec3f> points(static_cast<std::size_t>(bgr.cols));
    for (int y = rows.start; y < rows.end; ++y) {
      core::scenePoints(mm, bgr.size(), camera, y, points.data());
      const auto* pixel = bgr.ptr<cv::Vec3b>(y);
      for (const cv::Vec3f& point : points) {
        for (int i = 0; i < 3; ++i) {
          place[i] = point[i];
          color[i] = (*pixel)[i];
        }
        ++place, ++color, ++pixel;
      }
    }
  });
  return cloud;
}

OpticsMsg toMessage(const core::Optics& optics) {
  OpticsMsg message;
  message.focal_length_mm = optics.focal_length_mm;
  message.aperture = optics.aperture;
  message.circle_of_confusion_mm = optics.circle_of_confusion_mm;
  return message;
}

core::Optics toOptics(const OpticsMsg& message) {
  const core::Optics optics{message.focal_length_mm, message.aperture, message.circle_of_confusion_mm};
  validate(optics);
  return optics;
}

SegmentArrayPtr toMessage(const Segmentation& segmentation, const SegmentationConfig& config) {
  auto array = boost::make_shared<SegmentArray>();
  array->optics = toMessage(config.optics);
  array->dof_rule = name(config.span);
  array->unknown_area = static_cast<std::uint32_t>(segmentation.unknown_area);
  array->segments.reserve(segmentation.segments.size());
  for (const core::Segment& segment : segmentation.segments) {
    SegmentMsg message;
    message.label = static_cast<std::uint32_t>(segment.label);
    message.area = static_cast<std::uint32_t>(segment.area);
    message.depth_min = segment.min_mm / kMmPerM;
    message.depth_max = segment.max_mm / kMmPerM;
    message.depth_median = segment.median_mm / kMmPerM;
    message.diff = (segment.max_mm - segment.min_mm) / kMmPerM;
    message.max_dof = maxDof(config.optics, segment.min_mm, segment.max_mm) / kMmPerM;
    message.fits = segment.fits;
    message.focus_distance = dioptricMiddle(segment.min_mm, segment.max_mm) / kMmPerM;
    array->segments.push_back(message);
  }
  return array;
}

}  // namespace all_in_focus
