// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "all_in_focus/depth_registration.hpp"

using namespace all_in_focus::core;

namespace {

Camera camera(int width, int height, double f) {
  return {{width, height}, f, f, (width - 1) / 2.0, (height - 1) / 2.0, {}};
}

Rig sameCameras(int width = 64, int height = 48) {
  Rig rig;
  rig.depth = rig.color = camera(width, height, 50);
  return rig;
}

cv::Mat registered(const Rig& rig, const cv::Mat& depth, Splat splat) {
  cv::Mat out;
  DepthRegistration(rig, splat).compute(depth, out);
  return out;
}

cv::Mat constant(const cv::Size& size, int mm) {
  return cv::Mat(size, CV_16UC1, cv::Scalar(mm));
}

// One pixel a depth, in double, straight from equations 1 to 3.
cv::Mat reference(const Rig& rig, const cv::Mat& depth) {
  cv::Mat out = cv::Mat::zeros(rig.color.size, CV_16UC1);
  for (int v = 0; v < depth.rows; ++v) {
    for (int u = 0; u < depth.cols; ++u) {
      const double z = depth.at<std::uint16_t>(v, u);
      if (z == 0) continue;
      const cv::Point2d ray =
          rig.depth.undistort({(u - rig.depth.cx) / rig.depth.fx, (v - rig.depth.cy) / rig.depth.fy});
      const cv::Vec3d p = rig.depth_to_color.rotation * cv::Vec3d(ray.x * z, ray.y * z, z) +
                          rig.depth_to_color.translation_mm;
      if (p[2] <= 0) continue;
      const cv::Point2d q = rig.color.distort({p[0] / p[2], p[1] / p[2]});
      const int x = static_cast<int>(std::floor(q.x * rig.color.fx + rig.color.cx + 0.5));
      const int y = static_cast<int>(std::floor(q.y * rig.color.fy + rig.color.cy + 0.5));
      if (x < 0 || y < 0 || x >= out.cols || y >= out.rows) continue;
      auto& stored = out.at<std::uint16_t>(y, x);
      const int mm = static_cast<int>(p[2] + 0.5);
      if (stored == 0 || mm < stored) stored = static_cast<std::uint16_t>(mm);
    }
  }
  return out;
}

// Float and double may round a pixel to different sides now and then.
void expectNearlyEqual(const cv::Mat& a, const cv::Mat& b) {
  EXPECT_LE(cv::countNonZero(a != b), a.total() / 500);
}

TEST(DepthRegistration, IdentityChangesNothing) {
  const Rig rig = sameCameras();
  cv::Mat depth(48, 64, CV_16UC1);
  cv::randu(depth, 500, 5000);
  EXPECT_EQ(cv::countNonZero(registered(rig, depth, Splat::kPoint) != depth), 0);
}

TEST(DepthRegistration, HoldsTheDepthAlongTheColourAxis) {
  Rig rig = sameCameras();
  rig.depth_to_color.translation_mm = {0, 0, 250};  // the colour camera stands behind
  const cv::Mat out = registered(rig, constant(rig.depth.size, 1000), Splat::kFootprint);
  EXPECT_EQ(out.at<std::uint16_t>(24, 32), 1250);
}

TEST(DepthRegistration, MatchesTheEquationsOnRandomDepth) {
  Rig rig;
  rig.depth = camera(160, 120, 146);
  rig.color = camera(200, 150, 240);
  rig.depth_to_color = RigidTransform::fromQuaternion(0.01, -0.02, 0.015, 1, {0.03, -0.05, 0.02});
  cv::Mat depth(rig.depth.size, CV_16UC1);
  cv::randu(depth, 0, 4000);
  expectNearlyEqual(registered(rig, depth, Splat::kPoint), reference(rig, depth));
}

TEST(DepthRegistration, AppliesTheDistortionOfBothCameras) {
  Rig rig;
  rig.depth = camera(160, 120, 146);
  rig.color = camera(160, 120, 146);
  rig.depth.distortion = {-0.2, 0.05, 0.001, -0.002, 0.01};
  rig.color.distortion = {0.15, -0.03, -0.001, 0.001, 0, 0.01, 0.002, 0};
  rig.depth_to_color.translation_mm = {25, 0, 0};
  cv::Mat depth(rig.depth.size, CV_16UC1);
  cv::randu(depth, 800, 3000);
  expectNearlyEqual(registered(rig, depth, Splat::kPoint), reference(rig, depth));
}

TEST(DepthRegistration, NearestOfSeveralDepthsStays) {
  Rig rig = sameCameras();
  rig.color = camera(8, 6, 6.25);  // eight depth pixels on one colour pixel
  cv::Mat depth = constant(rig.depth.size, 3000);
  depth.at<std::uint16_t>(20, 20) = 900;
  const cv::Mat out = registered(rig, depth, Splat::kPoint);
  double nearest = 0, farthest = 0;
  cv::minMaxLoc(out, &nearest, &farthest);
  EXPECT_EQ(nearest, 900);
  EXPECT_EQ(cv::countNonZero(out == 900), 1);
  EXPECT_EQ(farthest, 3000);
}

TEST(DepthRegistration, PointsOutsideOrBehindAreDropped) {
  Rig rig = sameCameras();
  rig.depth_to_color.translation_mm = {100000, 0, 0};
  EXPECT_EQ(cv::countNonZero(registered(rig, constant(rig.depth.size, 1000), Splat::kPoint)), 0);
  rig.depth_to_color.translation_mm = {0, 0, -1000};  // in the lens
  EXPECT_EQ(cv::countNonZero(registered(rig, constant(rig.depth.size, 1000), Splat::kFootprint)), 0);
  rig.depth_to_color.translation_mm = {0, 0, -2000};  // behind it
  EXPECT_EQ(cv::countNonZero(registered(rig, constant(rig.depth.size, 1000), Splat::kFootprint)), 0);
  rig.depth_to_color.translation_mm = {0, 0, 65000};  // beyond 16 bits
  EXPECT_EQ(cv::countNonZero(registered(rig, constant(rig.depth.size, 1000), Splat::kFootprint)), 0);
}

TEST(DepthRegistration, UnknownStaysUnknown) {
  const Rig rig = sameCameras();
  EXPECT_EQ(cv::countNonZero(registered(rig, constant(rig.depth.size, 0), Splat::kFootprint)), 0);
}

TEST(DepthRegistration, FootprintsAreDenseAtHigherColourResolution) {
  Rig rig = sameCameras();
  rig.color = camera(256, 192, 200);
  rig.depth_to_color.translation_mm = {5, 3, 0};
  const cv::Mat out = registered(rig, constant(rig.depth.size, 1000), Splat::kFootprint);
  const cv::Mat inner = out(cv::Rect(24, 24, 208, 144));
  EXPECT_EQ(cv::countNonZero(inner), inner.rows * inner.cols);
  EXPECT_EQ(cv::countNonZero(registered(rig, constant(rig.depth.size, 1000),
                                        Splat::kPoint)(cv::Rect(24, 24, 208, 144)) != 0),
            inner.rows * inner.cols / 16);
}

TEST(DepthRegistration, FootprintsAreDenseAtAnyRoll) {
  for (const double degrees : {90.0, 45.0, -30.0, 180.0}) {
    Rig rig = sameCameras();
    rig.color = camera(150, 150, 150);
    const double half = degrees * CV_PI / 360;
    rig.depth_to_color = RigidTransform::fromQuaternion(0, 0, std::sin(half), std::cos(half), {0, 0, 0});
    const cv::Mat out = registered(rig, constant(rig.depth.size, 2000), Splat::kFootprint);
    const cv::Mat inner = out(cv::Rect(45, 45, 60, 60));
    EXPECT_EQ(cv::countNonZero(inner), 3600) << degrees;
  }
}

TEST(DepthRegistration, RollBy90DegreesTurnsThePicture) {
  Rig rig;
  rig.depth = rig.color = camera(64, 64, 50);
  rig.depth_to_color = RigidTransform::fromQuaternion(0, 0, std::sqrt(0.5), std::sqrt(0.5), {0, 0, 0});
  cv::Mat depth = constant(rig.depth.size, 2000);
  depth(cv::Rect(0, 0, 64, 10)) = 1000;  // top
  const cv::Mat out = registered(rig, depth, Splat::kPoint);
  EXPECT_EQ(cv::countNonZero(out(cv::Rect(54, 0, 10, 64)) == 1000), 640);  // right: X to Y, Y to -X
}

TEST(DepthRegistration, NearFootprintsHideTheFarSurface) {
  Rig rig = sameCameras();
  rig.color = camera(256, 192, 200);
  rig.depth_to_color.translation_mm = {40, 0, 0};
  cv::Mat depth = constant(rig.depth.size, 4000);
  depth(cv::Rect(20, 10, 20, 20)) = 800;
  const cv::Mat out = registered(rig, depth, Splat::kFootprint);
  // The panel moves by 40 * 200 / 800 = 10 px; inside it nothing of the wall shows through.
  const cv::Mat panel = out(cv::Rect(20 * 4 + 10 + 2, 10 * 4 + 2, 74, 74));
  EXPECT_EQ(cv::countNonZero(panel == 800), panel.rows * panel.cols);
}

TEST(DepthRegistration, RefusesWhatItCannotUse) {
  Rig rig = sameCameras();
  cv::Mat out;
  EXPECT_THROW(DepthRegistration(rig).compute(cv::Mat(48, 64, CV_32FC1), out), std::invalid_argument);
  EXPECT_THROW(DepthRegistration(rig).compute(cv::Mat(40, 64, CV_16UC1), out), std::invalid_argument);
  EXPECT_THROW(DepthRegistration(rig).compute(cv::Mat(), out), std::invalid_argument);
  rig.color.fx = 0;
  EXPECT_THROW(DepthRegistration{rig}, std::invalid_argument);
  EXPECT_THROW(RigidTransform::fromQuaternion(0, 0, 0, 0, {0, 0, 0}), std::invalid_argument);
  EXPECT_THROW(RigidTransform::fromQuaternion(0, 0, 0, 1, {1e307, 0, 0}), std::invalid_argument);  // in mm
}

TEST(RigidTransform, IsInMillimetres) {
  const auto turned = RigidTransform::fromQuaternion(0, 0, 2, 2, {0.025, 0, 0});  // by 90 degrees about Z
  EXPECT_NEAR(turned.translation_mm[0], 25, 1e-12);
  EXPECT_NEAR(turned.rotation(1, 0), 1, 1e-12);
}

TEST(DepthRegistration, WritesIntoPartOfAnImage) {
  const Rig rig = sameCameras();
  cv::Mat depth(48, 64, CV_16UC1);
  cv::randu(depth, 500, 5000);
  for (const Splat splat : {Splat::kPoint, Splat::kFootprint}) {
    cv::Mat whole(60, 100, CV_16UC1, cv::Scalar(7));
    cv::Mat part = whole(cv::Rect(20, 5, 64, 48));
    DepthRegistration(rig, splat).compute(depth, part);
    EXPECT_EQ(cv::countNonZero(part != registered(rig, depth, splat)), 0);
    EXPECT_EQ(cv::countNonZero(whole == 7), 60 * 100 - 48 * 64);
  }
}

TEST(DepthRegistration, DistortionDoesNotFoldTheWorldBack) {
  Rig rig = sameCameras();
  rig.depth.fx = rig.depth.fy = 12;  // sees far beyond the colour camera
  rig.color.distortion = {-0.35, 0.12, 0, 0, -0.02};
  EXPECT_LT(rig.color.reach(), 2.0);
  const cv::Mat out = registered(rig, constant(rig.depth.size, 1000), Splat::kPoint);
  cv::Mat far_side = constant(rig.depth.size, 1000);
  far_side(cv::Rect(8, 8, 48, 32)) = 0;  // only what lies outside the colour picture
  EXPECT_EQ(cv::countNonZero(registered(rig, far_side, Splat::kPoint)), 0);
  EXPECT_GT(cv::countNonZero(out), 0);
}

TEST(Camera, UndistortIsTheInverseOfDistort) {
  Camera c = camera(640, 480, 500);
  c.distortion = {-0.25, 0.08, 0.001, -0.0005, -0.01, 0.02, 0.001, 0.0003};
  for (double x = -0.6; x <= 0.6; x += 0.1) {
    for (double y = -0.45; y <= 0.45; y += 0.1) {
      const cv::Point2d there_and_back = c.undistort(c.distort({x, y}));
      EXPECT_NEAR(there_and_back.x, x, 1e-9);
      EXPECT_NEAR(there_and_back.y, y, 1e-9);
    }
  }
}

Camera fisheye() {
  Camera c = camera(640, 480, 200);
  c.setDistortion("equidistant", {-0.02, 0.004, -0.001, 0.0002});
  return c;
}

TEST(Camera, EquidistantIsTheFisheyeModelOfOpenCv) {
  // From cv2.fisheye.projectPoints.
  const cv::Point2d ideal[] = {{0.3, -0.2}, {1.5, 0.7}, {4, -3}};
  const cv::Point2d seen[] = {{0.287254903475036, -0.191503268983357},
                              {0.914601455435456, 0.426814012536546},
                              {1.068316363484516, -0.801237272613387}};
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(fisheye().distort(ideal[i]).x, seen[i].x, 1e-12);
    EXPECT_NEAR(fisheye().distort(ideal[i]).y, seen[i].y, 1e-12);
  }
}

TEST(Camera, FisheyeSeesNearlyAHalfSphere) {
  const Camera c = fisheye();
  EXPECT_NEAR(c.reach(), 10, 0.02);
  for (const double radius : {0.0, 0.1, 1.0, 3.0, 9.0}) {
    for (double angle = 0; angle < 6; angle += 0.7) {
      const cv::Point2d ideal(radius * std::cos(angle), radius * std::sin(angle));
      EXPECT_LT(cv::norm(c.undistort(c.distort(ideal)) - ideal), 1e-7);
    }
  }
  EXPECT_TRUE(std::isnan(c.undistort({2, 1}).x));  // behind the camera
}

TEST(DepthRegistration, FisheyeToFisheyeOfTheSameKindChangesNothing) {
  Rig rig;
  rig.depth = rig.color = fisheye();  // the corners are 110 degrees off the axis
  cv::Mat depth = constant(rig.depth.size, 1500);
  const cv::Mat out = registered(rig, depth, Splat::kPoint);
  const cv::Rect inside(120, 40, 400, 400);
  EXPECT_EQ(cv::countNonZero(out(inside) != 1500), 0);
  EXPECT_EQ(out.at<std::uint16_t>(0, 0), 0);
}

TEST(DepthRegistration, FisheyeIsNoPinhole) {
  Rig rig;
  rig.depth = rig.color = fisheye();
  rig.color.lens = LensModel::kPolynomial;
  rig.color.distortion = {};
  cv::Mat depth = cv::Mat::zeros(rig.depth.size, CV_16UC1);
  const cv::Point2d seen = fisheye().distort({0.8, 0.5});
  depth.at<std::uint16_t>(cvRound(seen.y * 200 + rig.depth.cy), cvRound(seen.x * 200 + rig.depth.cx)) = 1500;
  cv::Mat place;
  cv::findNonZero(registered(rig, depth, Splat::kPoint), place);
  ASSERT_EQ(place.total(), 1U);
  const cv::Point at = place.at<cv::Point>(0);
  EXPECT_NEAR(at.x, 0.8 * 200 + rig.color.cx, 1.5);
  EXPECT_NEAR(at.y, 0.5 * 200 + rig.color.cy, 1.5);
}

TEST(Camera, MatrixThatSaysMoreThanItsFourNumbers) {
  Camera c;
  const double skewed[] = {500, 3, 320, 0, 500, 240, 0, 0, 1}, scaled[] = {500, 0, 320, 0, 500, 240, 0, 0, 2};
  EXPECT_THROW(c.setMatrix(skewed), std::invalid_argument);
  EXPECT_THROW(c.setMatrix(scaled), std::invalid_argument);
  EXPECT_THROW(c.setDistortion("omni", {0, 0, 0, 0}), std::invalid_argument);
  EXPECT_THROW(c.setDistortion("equidistant", {0, 0, 0, 0, 0.1}), std::invalid_argument);
  EXPECT_NO_THROW(c.setDistortion("equidistant", {0, 0, 0, 0.1, 0}));
}

}  // namespace
