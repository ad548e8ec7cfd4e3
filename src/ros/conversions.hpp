// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FusionReport.h>
#include <all_in_focus/SegmentArray.h>
#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/dof_segmentation.hpp"
#include "all_in_focus/optics.hpp"

/// Convert between ROS messages and the types of the core. All functions throw std::invalid_argument with one
/// line that says what is wrong, where (a topic), and what to do.
namespace all_in_focus {

using namespace core;
using OpticsMsg = all_in_focus::Optics;  // two messages share their names with types of the core
using SegmentMsg = all_in_focus::Segment;
constexpr double kMmPerM = 1000;  // messages tell lengths in m, but for those of the lens

/// Depth of a message, CV_16UC1 mm, 0 = unknown. Accepts 16UC1 and mono16 (mm) and 32FC1 (m; NaN, infinite,
/// negative and above 65.535 m mean unknown), as REP 118 says. invalid_values: further mm values that mean
/// unknown. Where a 16-bit message holds none of them, the result is the message's own memory: do not write
/// to it, and keep the message.
cv::Mat toDepth(const sensor_msgs::Image& message, const std::vector<int>& invalid_values,
                const std::string& topic);

/// Throws unless the depth image has the size that its camera is calibrated for.
void requireSize(const cv::Mat& depth, const Camera& camera, const std::string& topic,
                 const std::string& info_topic);

/// The picture of a colour frame: bgr8, or bgr16 where the encoding has 16 bits. An image that is so already
/// is not copied.
cv_bridge::CvImageConstPtr toBgr(const sensor_msgs::ImageConstPtr& image, const std::string& topic);

/// A message of zeros to draw in. encoding: of sensor_msgs/image_encodings.h. `pixels` becomes a view of its
/// memory, which saves a copy.
sensor_msgs::ImagePtr blankImage(const std_msgs::Header& header, const std::string& encoding,
                                 const cv::Size& size, cv::Mat& pixels);

/// Models plumb_bob, rational_polynomial and "" (no distortion). Binning and region of interest are applied:
/// the camera is the one of the images on the wire. topic: of the camera_info.
Camera toCamera(const sensor_msgs::CameraInfo& info, const std::string& topic);

/// Throws if a region of interest is not that of images of this size: the camera would not be theirs. Without
/// a region images may have another resolution than the camera. topic: of the camera_info.
void requireRegion(const sensor_msgs::CameraInfo& info, const cv::Size& image, const std::string& topic);

/// A coloured cloud with the fields of depth_image_proc: x, y, z in m, rgb; a point for each pixel, row by
/// row, NaN where depth is unknown. bgr: CV_8UC3; mm: CV_16UC1 of the same size, 0 = unknown; camera: of
/// pictures of the same shape, in any resolution.
sensor_msgs::PointCloud2Ptr toPointCloud(const std_msgs::Header& header, const cv::Mat& bgr,
                                         const cv::Mat& mm, const core::Camera& camera);

OpticsMsg toMessage(const core::Optics& optics);
core::Optics toOptics(const OpticsMsg& message);

/// All but the header.
SegmentArrayPtr toMessage(const Segmentation& segmentation, const SegmentationConfig& config);

}  // namespace all_in_focus
