// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Every step of the method, each beside a plain copy of one colour frame, the yardstick of the machine.
//
//   bench_steps [--benchmark_filter=...] [RIG_FOLDER DEPTH.png]
//
// With a rig folder and a depth map of your own, or on a built scene: a slanted panel before a wall,
// quantised and with holes as a Kinect has them.

#include <benchmark/benchmark.h>

#include <cmath>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "all_in_focus/pipeline.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"

namespace {

using namespace all_in_focus;
using namespace all_in_focus::core;

struct Sample {
  Rig rig;
  cv::Mat depth;
  Optics optics;
};

Sample builtSample() {
  Sample sample;
  sample.rig.depth = {{640, 480}, 583.9, 586.7, 310.0, 251.7, {}};
  sample.rig.color = {{640, 480}, 810.2, 814.2, 309.9, 244.0, {}};
  sample.rig.depth_to_color.translation_mm = {-10.0, 53.9, 40.5};
  sample.depth.create(480, 640, CV_16UC1);
  cv::RNG random(1);
  for (int v = 0; v < 480; ++v) {
    for (int u = 0; u < 640; ++u) {
      const bool panel = u > 200 && u < 450 && v > 200;
      const double z = (panel ? 850.0 + 1.6 * (u - 200) : 2800.0 + 0.5 * u) + random.gaussian(1.0);
      const double disparity = std::round(8 * 580.0 * 75.0 / z) / 8;
      const bool hole = (u > 180 && u <= 200 && v > 200) || random.uniform(0, 100) < 2;
      sample.depth.at<std::uint16_t>(v, u) =
          hole ? 0 : cv::saturate_cast<std::uint16_t>(580.0 * 75.0 / disparity);
    }
  }
  return sample;
}

Sample& sample() {
  static Sample s = builtSample();
  return s;
}

void copyOneFrame(benchmark::State& state) {
  const cv::Mat from(480, 640, CV_8UC3, cv::Scalar(1, 2, 3));
  cv::Mat to(480, 640, CV_8UC3);
  for (auto _ : state) {
    std::memcpy(to.data, from.data, from.total() * from.elemSize());
    benchmark::ClobberMemory();
  }
}

void registerAndFill(benchmark::State& state, Mode mode) {
  DepthPreprocessing preprocessing(sample().rig, mode);
  cv::Mat registered, filled;
  for (auto _ : state) preprocessing.compute(sample().depth, registered, filled);
}

void segment(benchmark::State& state, Mode mode) {
  cv::Mat registered, filled;
  DepthPreprocessing(sample().rig, mode).compute(sample().depth, registered, filled);
  DofSegmentation segmentation(segmentationConfig(mode, sample().optics));
  Segmentation result;
  for (auto _ : state) segmentation.compute(filled, result);
  state.counters["regions"] = static_cast<double>(result.segments.size());
}

BracketScene scene() {
  BracketScene scene;
  DepthPreprocessing(sample().rig, Mode::kPaper).compute(sample().depth, scene.measured, scene.depth);
  Segmentation segmentation;
  DofSegmentation(segmentationConfig(Mode::kPaper, sample().optics)).compute(scene.depth, segmentation);
  scene.labels = segmentation.labels;
  scene.optics = sample().optics;
  scene.camera = sample().rig.color;
  return scene;
}

// Texture of all sizes. magnified: as a lens that breathes would show it.
cv::Mat textured(double magnified = 1) {
  cv::Mat frame(sample().rig.color.size, CV_8UC3);
  cv::theRNG().state = 1;
  cv::randu(frame, 0, 255);
  for (const double sigma : {1.0, 4.0}) {
    cv::Mat coarse(frame.size(), CV_8UC3);
    cv::randu(coarse, 0, 255);
    cv::GaussianBlur(coarse, coarse, cv::Size(), sigma);
    cv::normalize(coarse, coarse, 0, 255, cv::NORM_MINMAX);
    cv::addWeighted(frame, 0.5, coarse, 0.5, 0, frame);
  }
  const cv::Point2f center(frame.cols / 2.0f, frame.rows / 2.0f);
  cv::warpAffine(frame, frame, cv::getRotationMatrix2D(center, 0, magnified), frame.size(), cv::INTER_CUBIC,
                 cv::BORDER_REFLECT);
  return frame;
}

void fusePaper(benchmark::State& state) {
  const cv::Mat frame = textured();
  BracketFusion fusion;
  fusion.begin(scene(), Mode::kPaper);
  int index = 0;
  for (auto _ : state) fusion.add(frame, index++ % 1000);
}

void fuseRefined(benchmark::State& state, bool alignment) {
  const cv::Mat frames[] = {textured(), textured(1.01)};
  RefinedConfig config;
  config.alignment = alignment;
  BracketFusion fusion;
  fusion.begin(scene(), Mode::kRefined, config);
  int index = 0;
  for (auto _ : state) {
    fusion.add(frames[index % 2], index, 1000 + 100 * (index % 20));
    ++index;
  }
}

BENCHMARK(copyOneFrame)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(registerAndFill, paper, Mode::kPaper)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(registerAndFill, refined, Mode::kRefined)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(segment, paper, Mode::kPaper)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(segment, refined, Mode::kRefined)->Unit(benchmark::kMillisecond);
BENCHMARK(fusePaper)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(fuseRefined, without_alignment, false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(fuseRefined, aligned_and_warped, true)->Unit(benchmark::kMillisecond);

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc == 3) sample() = {readRig(argv[1]), readDepth(argv[2]), readOptics(argv[1])};
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
