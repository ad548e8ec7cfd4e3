// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

// Values that are possible but most likely a mistake, such as mm in the place of m. Each check returns one
// line for people that ends with the remedy, empty if there is nothing to say. fuse_stack, check_bag and the
// nodes say it in the same words.

/// Distance and rotation between the cameras: over 2 m, or 60 degrees between the optical axes. A camera that
/// is turned about its axis, as for a portrait, is no mistake.
std::string checkPose(const RigidTransform& depth_to_color);

/// Depth in m where mm are meant. depth: CV_16UC1 mm, 0 = unknown.
std::string checkDepthUnit(const cv::Mat& depth);

/// Share of the colour picture that gets a depth, 0..1, in cells of a few samples of the depth camera each.
/// registered: CV_16UC1 mm, 0 = unknown, as DepthRegistration of this rig has drawn it.
double coverage(const cv::Mat& registered, const Rig& rig);

/// A principal point outside the middle half of the picture. name: of the camera.
std::string checkPrincipalPoint(const Camera& camera, const char* name);

/// Under 30 % of the colour picture with a depth. registered: CV_16UC1 mm, 0 = unknown, as DepthRegistration
/// of this rig has drawn it. Throws std::invalid_argument if no depth falls into the picture.
std::string checkCoverage(const cv::Mat& registered, const Rig& rig);

/// A circle of confusion over a fiftieth of the sensor's width, which follows from f and the calibration of
/// the colour camera.
std::string checkCircleOfConfusion(const Optics& optics, const Camera& color);

/// A mirrored depth image: its edges clearly fit the picture better when it is flipped.
/// registered: CV_16UC1 mm, 0 = unknown, seen from the colour camera. mirrored: what registering the mirrored
/// depth image gives; empty: not known, then shifts that baseline and principal point can cause are tried.
/// picture: CV_8UC3 of the colour camera, of any resolution. Other types and shapes are not looked at.
std::string checkMirroring(const cv::Mat& registered, const cv::Mat& mirrored, const cv::Mat& picture);

}  // namespace all_in_focus::core
