// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "bench_scene.hpp"

#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <tuple>

namespace all_in_focus {
namespace {

constexpr double kNoiseMm = 3;
constexpr int kFrames = 5;

using Key = std::tuple<int, int, int>;

std::optional<Sample>& recorded() {
  static std::optional<Sample> sample;
  return sample;
}

Rig rigOf(const cv::Size& size) {
  const double f = 0.9 * size.width, cx = (size.width - 1) / 2.0, cy = (size.height - 1) / 2.0;
  const Camera depth{size, f, f, cx, cy}, color{size, 1.2 * f, 1.2 * f, cx, cy};
  return {depth, color, {cv::Matx33d::eye(), {-25, 10, 5}}};
}

// A slanted wall and floor with boards before them, 1 to 4 m away. x, y: 0..1.
double distanceMm(double x, double y) {
  double z = std::min(3400 + 600 * x, 1900 / std::max(y - 0.2, 0.1));
  for (int i = 0; i < 6; ++i) {
    const double from_x = 0.04 + 0.16 * i, from_y = 0.15 + 0.08 * (i * 5 % 7);
    const bool on_board = x > from_x && x < from_x + 0.12 && y > from_y && y < from_y + 0.35;
    if (on_board) z = std::min(z, 1000 + 350.0 * (i * 5 % 6) + 300 * (x - from_x) + 80 * (y - from_y));
  }
  return z;
}

double inKinectSteps(double z) {
  const double base = 580.0 * 75.0;  // focal length in pixels times mm between projector and camera
  return base / (std::round(8 * base / z) / 8);
}

cv::Mat depthOf(const cv::Size& size, Sensor sensor) {
  cv::Mat depth(size, CV_16UC1);
  cv::RNG random(1);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const double x = (u + 0.5) / size.width, y = (v + 0.5) / size.height;
      const double z = distanceMm(x, y);
      const bool shadow = distanceMm(x + 0.01, y) < z - 100;  // no light of the projector left of an edge
      const double measured =
          sensor == Sensor::kNoisy ? z + random.gaussian(kNoiseMm) : inKinectSteps(z + random.gaussian(1));
      depth.at<std::uint16_t>(v, u) = shadow ? 0 : cv::saturate_cast<std::uint16_t>(measured);
    }
  }
  return depth;
}

// Texture of all sizes.
cv::Mat textured(const cv::Size& size) {
  cv::Mat frame(size, CV_8UC3);
  cv::RNG random(1);
  random.fill(frame, cv::RNG::UNIFORM, 0, 255);
  for (const double sigma : {1.0, 4.0}) {
    cv::Mat coarse(size, CV_8UC3);
    random.fill(coarse, cv::RNG::UNIFORM, 0, 255);
    cv::GaussianBlur(coarse, coarse, cv::Size(), sigma);
    cv::normalize(coarse, coarse, 0, 255, cv::NORM_MINMAX);
    cv::addWeighted(frame, 0.5, coarse, 0.5, 0, frame);
  }
  return frame;
}

std::vector<cv::Mat> sweepOf(const cv::Size& size) {
  const cv::Mat sharp = textured(size);
  cv::Mat blurred;
  cv::GaussianBlur(sharp, blurred, cv::Size(), 2);
  std::vector<cv::Mat> frames;
  for (int i = 0; i < kFrames; ++i) {
    cv::Mat frame = blurred.clone();
    const cv::Rect band(i * size.width / kFrames, 0, size.width / kFrames, size.height);
    sharp(band).copyTo(frame(band));
    const cv::Mat larger = cv::getRotationMatrix2D(cv::Point2f(cv::Size2f(size)) / 2, 0, 1 + 0.004 * i);
    cv::warpAffine(frame, frame, larger, size, cv::INTER_CUBIC, cv::BORDER_REFLECT);
    frames.push_back(frame);
  }
  return frames;
}

}  // namespace

void Samples::setRecorded(const Sample& sample) {
  recorded() = sample;
}

const Sample& Samples::get(const cv::Size& size, Sensor sensor) {
  if (recorded() && recorded()->rig.color.size == size) return *recorded();
  static std::map<Key, Sample> samples;
  const auto found = samples.try_emplace(Key{size.width, size.height, static_cast<int>(sensor)});
  if (found.second) found.first->second = {rigOf(size), depthOf(size, sensor), {}};
  return found.first->second;
}

cv::Mat Samples::filled(const Sample& sample, Mode mode) {
  cv::Mat registered, filled;
  DepthPreprocessing(sample.rig, mode).compute(sample.depth, registered, filled);
  return filled;
}

cv::Mat Samples::withNoise(const cv::Mat& depth, int seed) {
  cv::Mat noisy = depth.clone();
  cv::RNG random(seed);
  for (auto z = noisy.begin<std::uint16_t>(); z != noisy.end<std::uint16_t>(); ++z) {
    if (*z > 0) *z = cv::saturate_cast<std::uint16_t>(*z + random.gaussian(kNoiseMm));
  }
  return noisy;
}

const BracketScene& Samples::scene(const Sample& sample) {
  static std::map<const Sample*, BracketScene> scenes;
  const auto found = scenes.try_emplace(&sample);
  BracketScene& scene = found.first->second;
  if (!found.second) return scene;
  DepthPreprocessing(sample.rig, Mode::kPaper).compute(sample.depth, scene.measured, scene.depth);
  Segmentation segmentation;
  DofSegmentation(segmentationConfig(Mode::kPaper, sample.optics)).compute(scene.depth, segmentation);
  scene.labels = segmentation.labels;
  scene.optics = sample.optics;
  scene.camera = sample.rig.color;
  return scene;
}

PipelineInput Samples::input(const Sample& sample, FramesInMemory& frames) {
  PipelineInput input;
  input.depth = sample.depth;
  input.rig = sample.rig;
  input.has_rig = true;
  input.optics = sample.optics;
  input.frames = &frames;
  input.focus_mm = {1000, 3000};
  return input;
}

const std::vector<cv::Mat>& Samples::sweep(const cv::Size& size) {
  static std::map<std::pair<int, int>, std::vector<cv::Mat>> sweeps;
  std::vector<cv::Mat>& frames = sweeps[{size.width, size.height}];
  if (frames.empty()) frames = sweepOf(size);
  return frames;
}

}  // namespace all_in_focus
