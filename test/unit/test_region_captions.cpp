// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cstdint>
#include <stdexcept>

#include "all_in_focus/drawing.hpp"
#include "all_in_focus/region_captions.hpp"

using namespace all_in_focus::core;

namespace {

Segment segment(const cv::Mat& labels, int label, int min_mm, int max_mm) {
  return {label, cv::countNonZero(labels == label), min_mm, max_mm, (min_mm + max_mm) / 2};
}

// A U of depth 0.92 to 1.05 m around a block of 2 m, a far speck; the rest is unknown.
Segmentation scene() {
  Segmentation scene;
  scene.labels = cv::Mat(240, 320, CV_32SC1, cv::Scalar(0));
  scene.labels(cv::Rect(40, 20, 200, 200)) = 1;
  scene.labels(cv::Rect(80, 0, 120, 180)) = 2;
  scene.labels(cv::Rect(300, 15, 6, 6)) = 3;
  scene.segments = {segment(scene.labels, 1, 920, 1050), segment(scene.labels, 2, 2000, 2000),
                    segment(scene.labels, 3, 3000, 3500)};
  return scene;
}

TEST(RegionCaptions, LieWellWithinTheirRegions) {
  const Segmentation segmentation = scene();
  const auto captions = captionRegions(segmentation);
  ASSERT_EQ(captions.size(), 2u);   // the speck is too small
  EXPECT_EQ(captions[0].label, 2);  // the largest first
  EXPECT_EQ(captions[0].text, "2: 2.00-2.00 m");
  EXPECT_EQ(captions[1].text, "1: 0.92-1.05 m");
  EXPECT_EQ(captions[1].near_mm, 920);
  EXPECT_NEAR(captions[0].anchor.x, 140, 3);
  EXPECT_NEAR(captions[0].anchor.y, 90, 3);
  for (const RegionCaption& caption : captions) {  // the centroid of the U lies outside of it
    const cv::Rect around(caption.anchor.x - 12, caption.anchor.y - 12, 25, 25);
    EXPECT_EQ(cv::countNonZero(segmentation.labels(around) != caption.label), 0) << caption.anchor;
    EXPECT_EQ(caption.written, caption.text);  // each has room, that of the U below the block
    EXPECT_EQ(cv::countNonZero(segmentation.labels(caption.box) != caption.label), 0) << caption.box;
  }
}

TEST(RegionCaptions, WhereTheTextHasNoRoomIsTheLabelOrNothing) {
  Segmentation segmentation = scene();
  segmentation.labels(cv::Rect(250, 0, 30, 240)) = 3;  // upright and narrow
  auto captions = captionRegions(segmentation, 0.04);  // 36 of 76800 pixels are 0.047 %
  ASSERT_EQ(captions.size(), 3u);
  EXPECT_EQ(captions[2].text, "3: 3.00-3.50 m");  // for markers, which have room
  EXPECT_EQ(captions[2].written, "3");
  EXPECT_EQ(cv::countNonZero(segmentation.labels(captions[2].box) != 3), 0);
  segmentation.labels(cv::Rect(240, 0, 80, 240)) = 3;
  EXPECT_EQ(captionRegions(segmentation, 0.04)[2].written, "3: 3.2 m");
  captions = captionRegions(scene(), 0.04);
  ASSERT_EQ(captions.size(), 3u);
  EXPECT_TRUE(cv::Rect(300, 15, 6, 6).contains(captions[2].anchor));
  EXPECT_EQ(captions[2].written, "");
  EXPECT_TRUE(captions[2].box.empty());
}

TEST(RegionCaptions, NothingKnownHasNoCaption) {
  Segmentation nothing;
  nothing.labels = cv::Mat(1, 1, CV_32SC1, cv::Scalar(0));
  EXPECT_TRUE(captionRegions(nothing, 0).empty());
  nothing.labels = cv::Mat(4, 4, CV_8UC1, cv::Scalar(0));
  EXPECT_THROW(captionRegions(nothing), std::invalid_argument);
}

TEST(RegionCaptions, WhatWouldCoverALargerRegionsCaptionIsLeftOut) {
  for (const int below : {112, 180}) {  // a band right below another one, or further down
    Segmentation bands;
    bands.labels = cv::Mat(240, 320, CV_32SC1, cv::Scalar(0));
    bands.labels(cv::Rect(60, below, 180, 12)) = 1;
    bands.labels(cv::Rect(60, 100, 200, 12)) = 2;
    bands.segments = {segment(bands.labels, 1, 900, 900), segment(bands.labels, 2, 2000, 2000)};
    const auto captions = captionRegions(bands);
    ASSERT_EQ(captions.size(), below == 112 ? 1u : 2u);
    EXPECT_EQ(captions[0].label, 2);
  }
}

TEST(DrawRegions, LegendGoesFromNearToFarBelowTheLabels) {
  const Segmentation segmentation = scene();
  cv::Mat picture;
  drawRegions(segmentation, {}, picture);
  ASSERT_EQ(picture.cols, 320);
  ASSERT_GT(picture.rows, 250);
  const auto colors = labelColors(3);
  EXPECT_EQ(picture.at<cv::Vec3b>(100, 60), colors[1]);
  EXPECT_EQ(picture.at<cv::Vec3b>(245, 0), colors[1]);
  EXPECT_EQ(picture.at<cv::Vec3b>(245, 319), colors[3]);
}

TEST(DrawRegions, PictureWithoutDepthHasTheSameSize) {
  Segmentation segmentation = scene();
  cv::Mat picture, without_depth;
  drawRegions(segmentation, {}, picture);
  segmentation.labels.setTo(0);
  segmentation.segments.clear();
  drawRegions(segmentation, {}, without_depth);
  EXPECT_EQ(without_depth.size(), picture.size());
  const cv::Mat legend = without_depth.rowRange(240, without_depth.rows).clone().reshape(1);
  EXPECT_EQ(cv::countNonZero(legend == 255), static_cast<int>(legend.total()));
}

TEST(DrawCaptions, WritesInsideThePicture) {
  const cv::Mat plain(240, 320, CV_8UC3, cv::Scalar(40, 80, 200));
  Segmentation edge;
  edge.labels = cv::Mat(plain.size(), CV_32SC1, cv::Scalar(0));
  edge.labels(cv::Rect(0, 0, 30, 30)) = 1;
  edge.segments = {segment(edge.labels, 1, 990, 1010)};
  const auto captions = captionRegions(edge);
  ASSERT_EQ(captions.size(), 1u);
  EXPECT_EQ(captions[0].written, "1");
  cv::Mat picture = plain.clone(), written;
  drawCaptions(captions, picture);
  cv::absdiff(plain, picture, written);
  EXPECT_GT(cv::countNonZero(written.reshape(1)), 300);  // 4742: it is not only a corner of a letter
  EXPECT_EQ(cv::countNonZero(written.col(0).clone().reshape(1)), 0);  // nothing is cut off
  EXPECT_EQ(cv::countNonZero(written.row(0).clone().reshape(1)), 0);
  const cv::Rect about = captions[0].box + cv::Point(-4, -4) + cv::Size(8, 12);
  written(about & cv::Rect(cv::Point(), written.size())) = cv::Scalar::all(0);
  EXPECT_EQ(cv::countNonZero(written.reshape(1)), 0);  // nor outside of its box
  cv::Mat gray(9, 9, CV_8UC1);
  EXPECT_THROW(drawCaptions(captions, gray), std::invalid_argument);
}

TEST(DrawWeightsLegend, ShowsTheHueOfEachFrame) {
  cv::Mat legend, weights;
  const cv::Mat index = (cv::Mat_<std::uint16_t>(1, 3) << 0, 1, 2);
  drawWeights(index, cv::Mat(1, 3, CV_8UC1, cv::Scalar(255)), 3, weights);
  drawWeightsLegend({"0: a.png, 0.8 m", "1: b.png", "2"}, legend);
  int row = 0;
  for (int i = 0; i < 3; ++i) {  // from top to bottom
    while (row < legend.rows && legend.at<cv::Vec3b>(row, 20) != weights.at<cv::Vec3b>(0, i)) ++row;
    EXPECT_LT(row, legend.rows) << i;
  }
  const cv::Size of_three = legend.size();
  drawWeightsLegend(std::vector<std::string>(1000, "0: a.png"), legend);
  EXPECT_LT(legend.rows, 10 * of_three.height);
  EXPECT_LT(legend.cols, 10 * of_three.width);
  drawWeightsLegend({}, legend);
  EXPECT_FALSE(legend.empty());
}

}  // namespace
