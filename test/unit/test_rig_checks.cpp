// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/rig_checks.hpp"

using namespace all_in_focus::core;

namespace {

bool says(const std::string& warning, const std::string& words) {
  return warning.find(words) != std::string::npos;
}

RigidTransform standing(double metres, double degrees) {
  const double half = degrees * CV_PI / 360;
  return RigidTransform::fromQuaternion(0, std::sin(half), 0, std::cos(half), {metres, 0, 0});
}

Rig sameCameras(const cv::Size& size) {
  Rig rig;
  rig.depth = rig.color = {size, 60, 60, (size.width - 1) / 2.0, (size.height - 1) / 2.0, {}};
  return rig;
}

// Boards before a wall, nothing in it symmetric: depth, mm, and a noisy picture, every board of its own grey.
struct Boards {
  cv::Mat depth{480, 640, CV_16UC1, cv::Scalar(3000)};
  cv::Mat picture{480, 640, CV_8UC3, cv::Scalar::all(120)};

  explicit Boards(int noise = 10) {
    const cv::Rect boards[] = {{40, 60, 90, 300}, {190, 20, 60, 200}, {300, 240, 110, 180}};
    for (int i = 0; i < 3; ++i) {
      depth(boards[i]).setTo(900 + 300 * i);
      picture(boards[i]).setTo(cv::Scalar::all(60 + 70 * i));
    }
    cv::Mat grain(picture.size(), CV_8UC3);
    cv::RNG random(1);
    random.fill(grain, cv::RNG::UNIFORM, 0, noise);
    picture += grain;
  }
};

cv::Mat turned(const cv::Mat& image) {
  cv::Mat flipped;
  cv::flip(image, flipped, 1);
  return flipped;
}

}  // namespace

TEST(RigChecks, PoseOfARigIsGood) {
  EXPECT_EQ(checkPose(standing(0.05, 1)), "");
  EXPECT_EQ(checkPose(standing(1.9, 59)), "");
}

TEST(RigChecks, PoseInMillimetresOrOtherAxes) {
  EXPECT_EQ(checkPose(standing(-2.5, 0)),
            "the depth camera stands 2.5 m from the colour camera, rotated by 0 degrees: are these mm?");
  EXPECT_TRUE(says(checkPose(standing(0.05, 90)), "rotated by 90 degrees: is it between the optical frames"));
}

TEST(RigChecks, CameraTurnedAboutItsAxis) {
  for (const double degrees : {90.0, 180.0, 270.0}) {
    const double half = degrees * CV_PI / 360;
    EXPECT_EQ(checkPose(RigidTransform::fromQuaternion(0, 0, std::sin(half), std::cos(half), {0.05, 0, 0})),
              "");
  }
}

TEST(RigChecks, PrincipalPointOfOtherPictures) {
  Camera color = sameCameras({480, 320}).color;
  EXPECT_EQ(checkPrincipalPoint(color, "colour"), "");
  color.cx = 130, color.cy = 90;
  EXPECT_EQ(checkPrincipalPoint(color, "colour"), "");
  color.cx = 59;  // of pictures binned by 4
  EXPECT_TRUE(
      says(checkPrincipalPoint(color, "colour"), "of the colour camera, 59, 90, is not in the middle half"));
  EXPECT_TRUE(says(checkPrincipalPoint(color, "colour"), "binning, region of interest"));
}

TEST(RigChecks, DepthInMetres) {
  EXPECT_EQ(checkDepthUnit(cv::Mat(480, 640, CV_16UC1, cv::Scalar(800))), "");
  EXPECT_EQ(checkDepthUnit(cv::Mat::zeros(480, 640, CV_16UC1)), "");
  EXPECT_TRUE(says(checkDepthUnit(cv::Mat(480, 640, CV_16UC1, cv::Scalar(3))),
                   "half of the depths are 3 or less: m"));
}

TEST(RigChecks, CoverageOfThePicture) {
  const Rig rig = sameCameras({100, 50});
  cv::Mat registered = cv::Mat::zeros(50, 100, CV_16UC1);
  EXPECT_THROW(checkCoverage(registered, rig), std::invalid_argument);
  registered.colRange(0, 4).setTo(1000);
  EXPECT_TRUE(says(checkCoverage(registered, rig),
                   "only 4 % of the colour picture gets a depth: check the transform"));
  registered.colRange(0, 28).setTo(1000);
  EXPECT_TRUE(says(checkCoverage(registered, rig), "only 28 %"));
  registered.colRange(0, 32).setTo(1000);
  EXPECT_EQ(checkCoverage(registered, rig), "");
}

TEST(RigChecks, SinglePointsCoverAPictureOfFinerPixels) {
  Rig rig = sameCameras({100, 50});
  rig.color.size = {1000, 500};
  rig.color.fx = rig.color.fy = 600;
  cv::Mat registered;
  rig.color.cx = 499.5, rig.color.cy = 249.5;
  DepthRegistration(rig, Splat::kPoint).compute(cv::Mat(50, 100, CV_16UC1, cv::Scalar(1000)), registered);
  ASSERT_LT(cv::countNonZero(registered), 0.02 * static_cast<double>(registered.total()));
  EXPECT_EQ(checkCoverage(registered, rig), "");
}

TEST(RigChecks, CircleOfConfusionOfTheSensor) {
  const Camera color = sameCameras({600, 400}).color;  // f = 24 mm: 240 mm wide
  EXPECT_EQ(checkCircleOfConfusion({24, 4, 4.7}, color), "");
  EXPECT_TRUE(says(checkCircleOfConfusion({24, 4, 4.9}, color),
                   "over a fiftieth of the sensor, which is 240 mm wide"));
}

TEST(RigChecks, MirroredDepthIsFound) {
  const Boards boards;
  EXPECT_EQ(checkMirroring(boards.depth, turned(boards.depth), boards.picture), "");
  EXPECT_EQ(checkMirroring(boards.depth, cv::Mat(), boards.picture), "");
  EXPECT_TRUE(
      says(checkMirroring(turned(boards.depth), boards.depth, boards.picture), "when it is mirrored"));
  EXPECT_TRUE(says(checkMirroring(turned(boards.depth), cv::Mat(), boards.picture), "when it is mirrored"));
}

TEST(RigChecks, MirroredDepthIsFoundBesideItsShadowsAndAtAnotherResolution) {
  Boards boards;
  boards.depth(cv::Rect(130, 60, 20, 300)).setTo(0);
  boards.depth(cv::Rect(410, 240, 15, 180)).setTo(0);
  cv::Mat large;
  cv::resize(boards.picture, large, {}, 3, 3, cv::INTER_LINEAR);
  EXPECT_EQ(checkMirroring(boards.depth, turned(boards.depth), large), "");
  EXPECT_TRUE(says(checkMirroring(turned(boards.depth), boards.depth, large), "when it is mirrored"));
}

TEST(RigChecks, NothingIsSaidOfMirroringWhereItIsNotClear) {
  const Boards boards;
  cv::Mat noise(480, 640, CV_8UC3);
  cv::RNG random(2);
  random.fill(noise, cv::RNG::UNIFORM, 0, 256);
  const cv::Mat flat(480, 640, CV_16UC1, cv::Scalar(1000));
  cv::Mat other_scene;
  cv::transpose(boards.picture, other_scene);
  cv::resize(other_scene, other_scene, boards.picture.size());
  for (const cv::Mat& mirrored : {cv::Mat(), boards.depth}) {
    EXPECT_EQ(checkMirroring(turned(boards.depth), mirrored, noise), "");
    EXPECT_EQ(checkMirroring(turned(boards.depth), mirrored, boards.picture * 0), "");
    EXPECT_EQ(checkMirroring(turned(boards.depth), mirrored, other_scene), "");
  }
  EXPECT_EQ(checkMirroring(flat, flat, boards.picture), "");
  EXPECT_EQ(checkMirroring(turned(boards.depth), boards.depth, boards.picture.rowRange(0, 100)),
            "");  // shape
  EXPECT_EQ(checkMirroring(turned(boards.depth), boards.depth, cv::Mat()), "");
  // At the width of the comparison this would have 160 million rows.
  cv::Mat column(500000, 1, CV_16UC1);
  cv::randu(column, 500, 5000);
  EXPECT_EQ(checkMirroring(column, column, cv::Mat(column.size(), CV_8UC3, cv::Scalar::all(9))), "");
}
