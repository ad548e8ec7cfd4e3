// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Every step of the method at several sizes, with one thread and with two.
//
//   bench_steps [--benchmark_filter=...] [RIG_FOLDER DEPTH.png]
//
// Depth is generated, with 3 mm of noise on every pixel but where a name says kinect: that has the steps of a
// Kinect. A rig folder and a depth map of your own take its place at the size of their colour camera.
//
// Counters of each: touched_bytes, what the step must read and write at least: inputs and outputs once,
// accumulators both ways; copies, its time over that of a plain copy, by one thread, that reads and writes as
// many bytes: 1 = as fast as memory allows; allocations and allocated_bytes, from the heap, per iteration
// when all buffers have grown to their size.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <iostream>
#include <opencv2/core.hpp>
#include <vector>

#include "allocations.hpp"
#include "bench_scene.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"

namespace {

using namespace all_in_focus;

constexpr int kWarmUp = 3;    // iterations until buffers have their size
constexpr int kBracket = 10;  // frames

cv::Size sizeOf(const benchmark::State& state) {
  return {static_cast<int>(state.range(0)), static_cast<int>(state.range(1))};
}

// Seconds that a plain copy takes which reads and writes that many bytes together.
double copySeconds(std::size_t bytes) {
  using Clock = std::chrono::steady_clock;
  const std::vector<char> from(bytes / 2, 1);
  std::vector<char> to(bytes / 2);
  std::vector<double> seconds;
  while (seconds.size() < 9) {
    const auto begin = Clock::now();
    std::memcpy(to.data(), from.data(), to.size());
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
    seconds.push_back(std::chrono::duration<double>(Clock::now() - begin).count());
  }
  std::nth_element(seconds.begin(), seconds.begin() + seconds.size() / 2, seconds.end());
  return seconds[seconds.size() / 2];
}

// Runs step() and reports. prepare() comes before every `every`-th step and counts for nothing.
template <typename Step, typename Prepare>
void measure(benchmark::State& state, std::size_t touched_bytes, Step step, int every, Prepare prepare) {
  using Clock = std::chrono::steady_clock;
  cv::setNumThreads(static_cast<int>(state.range(2)));
  Allocations taken;
  double seconds = 0;
  std::int64_t steps = 0;
  const auto run = [&] {
    if (steps++ % every == 0) prepare();
    const Allocations before = Allocations::soFar();
    const auto begin = Clock::now();
    step();
    const double elapsed = std::chrono::duration<double>(Clock::now() - begin).count();
    const Allocations after = Allocations::soFar();
    taken.calls += after.calls - before.calls;
    taken.bytes += after.bytes - before.bytes;
    seconds += elapsed;
    return elapsed;
  };
  while (steps < kWarmUp) run();
  taken = {};
  seconds = 0;
  for (auto _ : state) state.SetIterationTime(run());
  const double n = static_cast<double>(state.iterations());
  state.counters["touched_bytes"] = static_cast<double>(touched_bytes);
  state.counters["allocations"] = static_cast<double>(taken.calls) / n;
  state.counters["allocated_bytes"] = static_cast<double>(taken.bytes) / n;
  state.counters["copies"] = seconds / n / copySeconds(touched_bytes);
}

template <typename Step>
void measure(benchmark::State& state, std::size_t touched_bytes, Step step) {
  measure(state, touched_bytes, step, kWarmUp, [] {});
}

// Bytes a pixel: depth 2, labels 4, frame 3; of the accumulators of mode refined 20, both read and written.
std::size_t pixels(const cv::Size& size) {
  return static_cast<std::size_t>(size.area());
}

void copyFrame(benchmark::State& state) {
  const cv::Mat from(sizeOf(state), CV_8UC3, cv::Scalar(1, 2, 3));
  cv::Mat to = from.clone();
  const std::size_t bytes = from.total() * from.elemSize();
  measure(state, 2 * bytes, [&] {
    std::memcpy(to.data, from.data, bytes);
    benchmark::ClobberMemory();
  });
}

void registerAndFill(benchmark::State& state, Mode mode) {
  const Sample& sample = Samples::get(sizeOf(state), Sensor::kNoisy);
  DepthPreprocessing preprocessing(sample.rig, mode);
  cv::Mat registered, filled;
  measure(state, 2 * sample.depth.total() + 4 * pixels(sizeOf(state)),
          [&] { preprocessing.compute(sample.depth, registered, filled); });
}

void segment(benchmark::State& state, Mode mode, Sensor sensor) {
  const Sample& sample = Samples::get(sizeOf(state), Sensor::kKinect);
  const cv::Mat filled = Samples::filled(sample, mode);
  // Noise of its own in each image, as in a stream: it cannot be learnt by heart.
  const bool noisy = sensor == Sensor::kNoisy;
  std::vector<cv::Mat> depths(noisy ? 8 : 1, filled);
  for (std::size_t i = 0; noisy && i < depths.size(); ++i)
    depths[i] = Samples::withNoise(filled, static_cast<int>(i));
  DofSegmentation segmentation(segmentationConfig(mode, sample.optics));
  Segmentation result;
  for (int round = 0; round < 2; ++round) {  // until buffers have their size
    for (const cv::Mat& depth : depths) segmentation.compute(depth, result);
  }
  std::size_t next = 0;
  measure(state, 6 * pixels(sizeOf(state)),
          [&] { segmentation.compute(depths[next++ % depths.size()], result); });
  state.counters["regions"] = static_cast<double>(result.segments.size());
}

void fuse(benchmark::State& state, Mode mode, bool alignment) {
  const BracketScene& scene = Samples::scene(Samples::get(sizeOf(state), Sensor::kNoisy));
  const std::vector<cv::Mat>& frames = Samples::sweep(sizeOf(state));
  BracketSettings settings;
  settings.mode = mode;
  settings.refined.alignment = alignment;
  Bracket bracket;
  int index = 0;
  const auto add = [&] {
    bracket.add(frames[index % frames.size()], index, 1000 + 200 * index);
    ++index;
  };
  const auto begin = [&] {
    bracket.begin(scene, settings, {});
    index = 0;
    add();  // the reference: sets up, and is never warped
  };
  const std::size_t bytes_per_pixel = mode == Mode::kPaper ? 3 + 4 + 3 : 3 + 2 + 2 * 18 + 2;
  measure(state, bytes_per_pixel * pixels(sizeOf(state)), add, kBracket - 1, begin);
}

void runWithTwoFrames(benchmark::State& state, Mode mode) {
  const Sample& sample = Samples::get(sizeOf(state), Sensor::kNoisy);
  const std::vector<cv::Mat>& sweep = Samples::sweep(sizeOf(state));
  FramesInMemory frames({sweep.front(), sweep.back()});
  const PipelineInput input = Samples::input(sample, frames);
  Pipeline pipeline(mode);
  const std::size_t depth_and_labels = 4 + 4, two_frames = 6, image_index_confidence = 6;
  measure(state,
          2 * sample.depth.total() +
              (depth_and_labels + two_frames + image_index_confidence) * pixels(sizeOf(state)),
          [&] {
            frames.rewind();
            benchmark::DoNotOptimize(pipeline.run(input));
          });
}

void atAllSizes(benchmark::internal::Benchmark* step) {
  const int sizes[][2] = {{320, 240}, {640, 480}, {1280, 720}, {2208, 1242}, {4416, 1242}};
  step->ArgNames({"width", "height", "threads"})->UseManualTime()->Unit(benchmark::kMillisecond);
  for (const auto& size : sizes) {
    for (const int threads : {1, 2}) step->Args({size[0], size[1], threads});
  }
}

BENCHMARK(copyFrame)->Apply(atAllSizes);
BENCHMARK_CAPTURE(registerAndFill, paper, Mode::kPaper)->Apply(atAllSizes);
BENCHMARK_CAPTURE(registerAndFill, refined, Mode::kRefined)->Apply(atAllSizes);
BENCHMARK_CAPTURE(segment, paper_kinect, Mode::kPaper, Sensor::kKinect)->Apply(atAllSizes);
BENCHMARK_CAPTURE(segment, paper_noisy, Mode::kPaper, Sensor::kNoisy)->Apply(atAllSizes);
BENCHMARK_CAPTURE(segment, refined_kinect, Mode::kRefined, Sensor::kKinect)->Apply(atAllSizes);
BENCHMARK_CAPTURE(segment, refined_noisy, Mode::kRefined, Sensor::kNoisy)->Apply(atAllSizes);
BENCHMARK_CAPTURE(fuse, paper, Mode::kPaper, false)->Apply(atAllSizes);
BENCHMARK_CAPTURE(fuse, refined_without_alignment, Mode::kRefined, false)->Apply(atAllSizes);
BENCHMARK_CAPTURE(fuse, refined_aligned, Mode::kRefined, true)->Apply(atAllSizes);
BENCHMARK_CAPTURE(runWithTwoFrames, paper, Mode::kPaper)->Apply(atAllSizes);
BENCHMARK_CAPTURE(runWithTwoFrames, refined, Mode::kRefined)->Apply(atAllSizes);

int fail(const std::string& reason) {
  std::cerr << "bench_steps: " << reason << '\n';
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (argc != 1 && argc != 3)
    return fail("give RIG_FOLDER and DEPTH.png, or nothing, and --benchmark_ options");
  try {
    if (argc == 3) {
      const Sample recorded{readRig(argv[1]), readDepth(argv[2]), readOptics(argv[1])};
      if (recorded.depth.size() != recorded.rig.depth.size) {
        return fail(std::string(argv[2]) + ": not of the size of the rig's depth camera");
      }
      Samples::setRecorded(recorded);
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& e) {
    return fail(e.what());
  }
  return 0;
}
