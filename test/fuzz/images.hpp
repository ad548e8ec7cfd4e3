// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <random>
#include <utility>
#include <vector>

#include "input.hpp"

namespace all_in_focus::fuzz {

constexpr int kMostSide = 64;  // pixels, of images that are compared with plain definitions

inline cv::Size sizeFrom(Input& input, int most = kMostSide) {
  const int width = input.below(most + 1);
  return {width, input.below(most + 1)};
}

/// Several threads for one input in eight, while it lives: they take longer for tiny images.
class ThreadsFrom {
 public:
  explicit ThreadsFrom(Input& input) : usual_(cv::getNumThreads()) {
    cv::setNumThreads(input.below(8) == 7 ? 3 : 1);
  }
  ~ThreadsFrom() { cv::setNumThreads(usual_); }
  ThreadsFrom(const ThreadsFrom&) = delete;
  ThreadsFrom& operator=(const ThreadsFrom&) = delete;

 private:
  int usual_;
};

/// How the depths of an image are given.
enum DepthKind {
  kEach,   // a number for each pixel: as random as the input is
  kSteps,  // small differences from a common depth: surfaces, noise
  kNoise,  // between two depths, from few bytes
  kBoxes,  // rectangles before a background: edges, holes
  kDepthKinds
};

/// CV_16UC1.
inline cv::Mat depthFrom(Input& input, const cv::Size& size) {
  cv::Mat1w depth(size);
  const int kind = input.below(kDepthKinds);
  const auto base = kind == kEach ? std::uint16_t{0} : input.take<std::uint16_t>();
  if (kind == kEach) {
    for (auto& mm : depth) mm = input.take<std::uint16_t>();
  } else if (kind == kSteps) {
    const int scale = 1 + input.take<std::uint8_t>();
    for (auto& mm : depth) mm = static_cast<std::uint16_t>(base + scale * input.take<std::int8_t>());
  } else if (kind == kNoise) {
    const auto range = std::max<std::uint16_t>(1, input.take<std::uint16_t>());
    std::minstd_rand random(input.take<std::uint16_t>());
    for (auto& mm : depth) mm = static_cast<std::uint16_t>(base + random() % range);
  } else {
    depth = base;
    for (int i = input.below(16); i > 0; --i) {
      const cv::Point from(input.below(kMostSide), input.below(kMostSide));
      const cv::Rect box(from, cv::Size(input.below(kMostSide), input.below(kMostSide)));
      depth(box & cv::Rect({}, size)) = input.take<std::uint16_t>();
    }
  }
  return depth;
}

/// Size and depth of an image, for sizeFrom() and depthFrom().
inline Seed& putSize(Seed& seed, const cv::Size& size) {
  return seed.below(size.width).below(size.height);
}

inline Seed& putNoise(Seed& seed, std::uint16_t base, std::uint16_t range, std::uint16_t number = 1) {
  return seed.below(kNoise).put(base).put(range).put(number);
}

inline Seed& putBoxes(Seed& seed, std::uint16_t background,
                      const std::vector<std::pair<cv::Rect, std::uint16_t>>& boxes) {
  seed.below(kBoxes).put(background).below(static_cast<int>(boxes.size()));
  for (const auto& [box, mm] : boxes)
    seed.below(box.x).below(box.y).below(box.width).below(box.height).put(mm);
  return seed;
}

inline bool isSame(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && (a.empty() || cv::norm(a, b, cv::NORM_INF) == 0);
}

/// Noise with contrast at every pixel, CV_8UC3, from few bytes.
inline cv::Mat pictureFrom(Input& input, const cv::Size& size) {
  cv::Mat picture(size, CV_8UC3);
  const std::uint8_t base = input.take<std::uint8_t>(), range = input.take<std::uint8_t>();
  std::minstd_rand random(input.take<std::uint8_t>());
  for (auto& pixel : cv::Mat3b(picture)) {
    for (auto& code : pixel.val) code = static_cast<std::uint8_t>(base + random() % (range + 1));
  }
  return picture;
}

inline Seed& putPicture(Seed& seed, int base, int range, int number) {
  return seed.below(base).below(range).below(number);
}

}  // namespace all_in_focus::fuzz
