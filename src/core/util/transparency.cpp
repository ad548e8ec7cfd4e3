// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/transparency.hpp"

#include <algorithm>
#include <cstring>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "all_in_focus/codes.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kDark = 8;  // 8-bit code; a darker picture may well end in black

// In most pictures the first pixel of a line shows already that it is not.
bool isBlack(const cv::Mat& line) {
  for (int y = 0; y < line.rows; ++y) {
    const uchar* const codes = line.ptr(y);
    if (std::any_of(codes, codes + line.cols * line.elemSize(), [](uchar code) { return code != 0; }))
      return false;
  }
  return true;
}

// How many of `count` lines, from the first one on, are black and end at a picture; the line where both mix
// is one of them.
int emptyLines(int count, const std::function<cv::Mat(int)>& line) {
  int empty = 0;
  while (empty < count && isBlack(line(empty))) ++empty;
  if (empty == 0 || empty + 1 >= count) return 0;
  const cv::Mat beside = line(empty + 1);
  const cv::Scalar sum = cv::sum(beside);
  const double code = (sum[0] + sum[1] + sum[2]) / (3.0 * static_cast<double>(beside.total()));
  return code < (beside.depth() == CV_16U ? kDeepPerCode : 1) * kDark ? 0 : empty + 1;
}

cv::Rect insideOfEmptyBorder(const cv::Mat& frame) {
  const int w = frame.cols, h = frame.rows;
  const int top = emptyLines(h, [&](int i) { return frame.row(i); });
  const int bottom = emptyLines(h, [&](int i) { return frame.row(h - 1 - i); });
  const int left = emptyLines(w, [&](int i) { return frame.col(i); });
  const int right = emptyLines(w, [&](int i) { return frame.col(w - 1 - i); });
  return {left, top, w - left - right, h - top - bottom};
}

}  // namespace

void continueFromNearest(const cv::Mat& known, cv::Mat& image) {
  cv::Mat distance, nearest;
  cv::distanceTransform(known == 0, distance, nearest, cv::DIST_L2, cv::DIST_MASK_5, cv::DIST_LABEL_PIXEL);
  std::vector<cv::Point> place(static_cast<std::size_t>(cv::countNonZero(known)) + 1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      if (known.at<uchar>(y, x) != 0) place[static_cast<std::size_t>(nearest.at<int>(y, x))] = {x, y};
    }
  }
  const std::size_t bytes = image.elemSize();
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      if (known.at<uchar>(y, x) != 0) continue;
      const cv::Point from = place[static_cast<std::size_t>(nearest.at<int>(y, x))];
      std::memcpy(image.ptr(y) + x * bytes, image.ptr(from.y) + from.x * bytes, bytes);
    }
  }
}

cv::Mat contentOf(const cv::Mat& frame, cv::Mat& opaque) {
  opaque.release();
  cv::Mat color = frame;
  if (frame.channels() == 4) {
    cv::Mat alpha;
    cv::extractChannel(frame, alpha, 3);
    cv::compare(alpha, 0, opaque, cv::CMP_GT);
    cv::cvtColor(frame, color, cv::COLOR_BGRA2BGR);
  } else if (const cv::Rect inside = insideOfEmptyBorder(frame);
             inside.size() != frame.size() && !inside.empty()) {
    opaque = cv::Mat::zeros(frame.size(), CV_8UC1);
    opaque(inside).setTo(255);
    color = frame.clone();
  }
  if (opaque.empty()) return color;
  const int shown = cv::countNonZero(opaque);
  if (shown == static_cast<int>(opaque.total())) {
    opaque.release();
  } else if (shown > 0) {
    continueFromNearest(opaque, color);
  }
  return color;
}

}  // namespace all_in_focus::core
