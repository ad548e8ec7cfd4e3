// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The pictures of docs/algorithms.md: what every step of modes refined and restored makes of
// scene motorcycle.
//
//   make_scene --scene motorcycle --optics 85,2,0.03 --output SCENE
//   algorithm_pictures --scene SCENE --output docs/images/algorithms

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/drawing.hpp"
#include "command_line.hpp"
#include "fusion/bracket_fusion.hpp"
#include "fusion/defocus_prediction.hpp"
#include "fusion/sharpness_pyramid.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"
#include "stack_reader.hpp"

namespace po = boost::program_options;
using namespace all_in_focus;
using namespace all_in_focus::core;

namespace {

constexpr int kWidth = 320;
constexpr int kShown = 3;           // frame whose evidence is shown
constexpr int kCorrectionGain = 3;  // of the contrast of what mode restored corrects

// From red (nearest) to blue (farthest), evenly in dioptres; unknown depth is black.
cv::Mat depthPicture(const cv::Mat& depth, double nearest_mm, double farthest_mm) {
  const double hues = 120 / (1 / nearest_mm - 1 / farthest_mm);
  cv::Mat hue, picture;
  inverseDepthOf(depth, depth.size()).convertTo(hue, CV_8U, -hues, hues / nearest_mm);
  cv::merge(std::vector<cv::Mat>{hue, cv::Mat(depth.size(), CV_8UC1, cv::Scalar(220)), depth > 0}, picture);
  cv::cvtColor(picture, picture, cv::COLOR_HSV2BGR);
  return picture;
}

struct CloseUp {
  const char* name;
  cv::Rect place;
};
const CloseUp kCloseUps[] = {{"close_up_mirror", {326, 96, 52, 52}}, {"close_up_wheel", {600, 330, 52, 52}}};
constexpr int kEnlarged = 3;

struct Scene {
  PipelineInput input;
  std::vector<cv::Mat> frames;
  cv::Mat truth;
};

Scene readScene(const std::string& folder, StackReader& stack) {
  Scene scene;
  scene.input.rig = readRig(folder + "/rig");
  scene.input.has_rig = true;
  scene.input.optics = readOptics(folder + "/rig");
  scene.input.depth = readDepth(folder + "/depth.png");
  scene.input.focus_mm = readFocus(folder + "/focus.yaml", stack.names());
  scene.input.frames = &stack;
  for (cv::Mat frame; stack.next(frame);) scene.frames.push_back(frame.clone());
  scene.truth = readColor(folder + "/truth.png");
  return scene;
}

void write(const std::string& path, const cv::Mat& picture) {
  if (!cv::imwrite(path, picture, {cv::IMWRITE_JPEG_QUALITY, 88})) {
    throw std::invalid_argument(path + ": cannot be written");
  }
}

// Colours from least (dark) to most (bright).
cv::Mat colored(const cv::Mat& values, double least, double most, int map = cv::COLORMAP_INFERNO) {
  cv::Mat scaled, picture;
  values.convertTo(scaled, CV_8U, 255 / (most - least), -255 * least / (most - least));
  cv::applyColorMap(scaled, picture, map);
  return picture;
}

// Decimal logarithm; of values below 1: 0.
cv::Mat decades(const cv::Mat& values) {
  cv::Mat logarithm;
  cv::log(cv::max(values, 1), logarithm);
  return logarithm / std::log(10);
}

cv::Mat grayOf(const cv::Mat& frame) {
  cv::Mat gray;
  cv::cvtColor(frame, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

// Share of one frame in the weights, 0..255: what a little more light in it, too little for evidence of 8
// bits, changes of the mean of 16.
cv::Mat shareOf(int wanted, const Scene& scene, const BracketScene& bracket) {
  constexpr double kMore = 100;
  RefinedConfig config;
  config.alignment = config.exposure = false;
  const auto fused = [&](double more) {
    BracketFusion fusion;
    fusion.begin(bracket, scene.truth.size(), Mode::kRefined, config);
    for (int i = 0; i < static_cast<int>(scene.frames.size()); ++i) {
      cv::Mat frame;
      scene.frames[i].convertTo(frame, CV_16U, kDeepPerCode, i == wanted ? more : 0);
      fusion.add(frame, i, scene.input.focus_mm[i]);
    }
    return fusion.result().image;
  };
  cv::Mat share;
  cv::Mat(fused(kMore) - fused(0)).convertTo(share, CV_8U, 255 / kMore);
  return grayOf(share);
}

cv::Mat bestSingleFrame(const Scene& scene) {
  const auto psnr = [&](const cv::Mat& frame) { return cv::PSNR(frame, scene.truth); };
  return *std::max_element(scene.frames.begin(), scene.frames.end(),
                           [&](const cv::Mat& a, const cv::Mat& b) { return psnr(a) < psnr(b); });
}

// The same place of all images, side by side.
cv::Mat enlarge(const std::vector<cv::Mat>& images, const cv::Rect& place) {
  const cv::Mat gap(place.height * kEnlarged, 4, CV_8UC3, cv::Scalar::all(255));
  std::vector<cv::Mat> row;
  for (const cv::Mat& image : images) {
    cv::Mat tile;
    cv::resize(image(place), tile, {}, kEnlarged, kEnlarged, cv::INTER_NEAREST);
    if (!row.empty()) row.push_back(gap);
    row.push_back(tile);
  }
  cv::Mat picture;
  cv::hconcat(row, picture);
  return picture;
}

// Of every pixel, at the finest scale or over all of them.
cv::Mat sharpnessOf(const cv::Mat& gray, bool scales) {
  SharpnessPyramid pyramid;
  pyramid.begin(gray, {NoiseSpectrum(), 1, scales});
  return pyramid.compute({0, gray.rows});
}

void drawAll(const po::variables_map& values) {
  const std::string folder = textOption(values, "scene"), output = textOption(values, "output");
  StackReader stack(folder + "/stack");
  const Scene scene = readScene(folder, stack);
  const int count = static_cast<int>(scene.frames.size());
  if (count <= kShown || scene.truth.size() != cv::Size(741, 500)) {
    throw std::invalid_argument(folder + ": not scene motorcycle");
  }
  stack.rewind();
  const PipelineResult paper = Pipeline(Mode::kPaper).run(scene.input);
  stack.rewind();
  const PipelineResult result = Pipeline(Mode::kRefined).run(scene.input);
  stack.rewind();
  const PipelineResult restored = Pipeline(Mode::kRestored).run(scene.input);

  std::filesystem::create_directories(output);
  const auto save = [&](const char* name, const cv::Mat& picture, int interpolation = cv::INTER_AREA) {
    cv::Mat small;
    const int height = cvRound(static_cast<double>(picture.rows) * kWidth / picture.cols);
    cv::resize(picture, small, {kWidth, height}, 0, 0, interpolation);
    write(output + "/" + name + ".jpg", small);
  };

  double nearest, farthest;
  cv::minMaxLoc(result.filled, &nearest, &farthest, nullptr, nullptr, result.filled > 0);
  cv::Mat picture;
  const auto save_depth = [&](const char* name, const cv::Mat& depth) {
    save(name, depthPicture(depth, nearest, farthest), cv::INTER_AREA);
  };
  save_depth("depth_raw", scene.input.depth);
  save_depth("depth_registered", result.registered);
  save_depth("depth_filled", result.filled);
  drawRegions(result.segmentation, captionRegions(result.segmentation), picture);
  save("regions", picture, cv::INTER_AREA);
  save("frame_near", scene.frames.front());
  save("frame_far", scene.frames.back());
  save("frame", scene.frames[kShown]);

  const BracketScene bracket{{}, result.filled, result.registered, scene.input.optics, scene.input.rig.color};
  const cv::Mat gray = grayOf(scene.frames[kShown]);
  save("sharpness", colored(decades(sharpnessOf(gray, false)), 0, 2));
  save("sharpness_scales", colored(decades(sharpnessOf(gray, true)), 1, 9));
  cv::Mat squared_error;
  DefocusPrediction prediction;
  prediction.begin(bracket.depth, bracket.measured, scene.truth.size(), bracket.optics,
                   bracket.calibratedPitch());
  prediction.compute(scene.input.focus_mm[kShown], squared_error);
  cv::resize(squared_error, squared_error, scene.truth.size(), 0, 0, cv::INTER_LINEAR);
  save("predicted_error", colored(decades(squared_error), 0, 5));
  save("share", colored(shareOf(kShown, scene, bracket), 0, 255));

  drawWeights(result.bracket.source_index, result.bracket.confidence, count, picture);
  save("winners", picture, cv::INTER_NEAREST);
  save("confidence", colored(result.bracket.confidence, 128, 255));
  save("result", result.bracket.image);

  save_depth("depth_restored", restored.bracket.restored_depth);
  cv::Mat correction;
  cv::subtract(restored.bracket.image, result.bracket.image, correction, cv::noArray(), CV_16S);
  correction.convertTo(correction, CV_8U, kCorrectionGain, 128);
  save("correction", correction);
  const std::vector<cv::Mat> compared = {bestSingleFrame(scene), paper.bracket.image, result.bracket.image,
                                         restored.bracket.image, scene.truth};
  for (const CloseUp& close_up : kCloseUps) {
    write(output + "/" + close_up.name + ".jpg", enlarge(compared, close_up.place));
  }
}

}  // namespace

int main(int argc, char** argv) {
  po::options_description options("Options");
  options.add_options()("help", "this text")                                           //
      ("scene", po::value<std::string>()->required(), "folder that make_scene wrote")  //
      ("output", po::value<std::string>()->required(), "folder for the pictures");
  runTool(argc, argv, options,
          {"a picture of every step of modes refined and restored", {"scene"}, {"output"}, drawAll});
}
