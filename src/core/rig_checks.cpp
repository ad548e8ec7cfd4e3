// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/rig_checks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "all_in_focus/depth_registration.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kFarApart = 2.0;        // m between the cameras; more are probably mm
constexpr double kAxesApart = 60;        // degrees; more are probably other axes
constexpr double kLittleCoverage = 0.3;  // share of the picture
constexpr double kSamplesPerCell = 4;    // depth pixels in a cell of the picture where depth is known
constexpr int kProbablyMetres = 20;      // mm

// Depth edges and picture are compared at this width, so that a sharp frame is not needed.
constexpr int kWidth = 320;
constexpr double kMostElongated = 20;  // of a picture: longer over shorter side
constexpr double kDepthStep = 1.1;     // ratio of two depths side by side that makes an edge
constexpr int kWidestHole = kWidth / 8;
constexpr std::size_t kEdges = 1000;  // so many are compared at most ...
constexpr std::size_t kFewEdges = 100;
constexpr double kNearShare =
    0.05;  // of the edges that are nearer than the distance that moves by `parallax`
constexpr int kParallax = kWidth / 5, kShift = kWidth / 8, kStep = 3;  // pixels that are tried either way
constexpr int kSlack = 2;                                              // pixels that a good rig is off
// How much better the mirrored image must fit, in mean rank, and how much better a fit must be than the mean
// of all shifts, in their standard deviations. Measured on generated scenes and a recorded sweep with right,
// mirrored and shifted rigs.
constexpr double kClearlyBetter = 0.05;
constexpr double kFitsInPlace = 2.5, kFitsSomewhere = 3.0;
constexpr double kStillInPicture = 0.7;  // share of the edges

// Vertical edges of a depth map, in pixels of a picture that is kWidth wide.
struct DepthEdges {
  std::vector<cv::Point2f> places;
  std::vector<float> inverse_depth;  // of the nearer side; 1 at the near end of the scene

  DepthEdges mirrored() const {
    DepthEdges flipped = *this;
    for (cv::Point2f& place : flipped.places) place.x = kWidth - 1 - place.x;
    return flipped;
  }
};

cv::Size reducedSize(const cv::Size& size) {
  return {kWidth, std::max(1, cvRound(static_cast<double>(size.height) * kWidth / size.width))};
}

DepthEdges findEdges(const cv::Mat& depth) {
  cv::Mat small;
  resizeDepth(depth, reducedSize(depth.size()), small);
  DepthEdges all;
  std::vector<int> near;
  for (int y = 0; y < small.rows; ++y) {
    const auto* row = small.ptr<std::uint16_t>(y);
    int last = -1;  // the pixel with a depth before this one
    for (int x = 0; x < small.cols; ++x) {
      if (row[x] == 0) continue;
      if (last >= 0 && x - last <= kWidestHole) {
        const auto [nearer, farther] = std::minmax(row[last], row[x]);
        if (farther > kDepthStep * nearer) {
          // A hole beside an edge belongs to the background.
          const int side = row[last] < row[x] ? last + 1 : x;
          all.places.emplace_back(static_cast<float>(side) - 0.5F, static_cast<float>(y));
          near.push_back(nearer);
        }
      }
      last = x;
    }
  }
  if (near.size() < kFewEdges) return {};
  std::vector<int> sorted = near;
  const auto front =
      sorted.begin() + static_cast<std::ptrdiff_t>(kNearShare * static_cast<double>(sorted.size()));
  std::nth_element(sorted.begin(), front, sorted.end());
  DepthEdges edges;
  const double every = std::max(1.0, static_cast<double>(near.size()) / kEdges);
  for (double i = 0; i < static_cast<double>(near.size()); i += every) {
    const auto index = static_cast<std::size_t>(i);
    edges.places.push_back(all.places[index]);
    edges.inverse_depth.push_back(static_cast<float>(*front) / static_cast<float>(near[index]));
  }
  return edges;
}

// For each pixel the share of the picture whose brightness changes less from left to right: 0.5 on average.
cv::Mat1f rankOfGradient(const cv::Mat& picture) {
  cv::Mat gray, small, gradient;
  cv::resize(picture, small, reducedSize(picture.size()), 0, 0, cv::INTER_AREA);
  cv::cvtColor(small, gray, cv::COLOR_BGR2GRAY);
  cv::GaussianBlur(gray, gray, cv::Size(), 1);
  cv::Sobel(gray, gradient, CV_16S, 1, 0);
  cv::convertScaleAbs(gradient, gradient, 0.5);
  cv::dilate(gradient, gradient, cv::Mat::ones(1, 3, CV_8U));
  double least = 0;
  cv::minMaxLoc(gradient, &least);
  const cv::Mat is_least = gradient == least;  // whose rank equalizeHist() takes for 0
  const double share = cv::countNonZero(is_least) / static_cast<double>(gradient.total());
  cv::equalizeHist(gradient, gradient);
  cv::Mat1f ranks;
  gradient.convertTo(ranks, CV_32F, (1 - share) / 255, share);
  ranks.setTo(share / 2, is_least);
  return ranks;
}

// Mean rank of the picture under the edges when all are moved by `shift`, and the near ones by `parallax`
// more; NaN when too many leave the picture.
double meanRank(const DepthEdges& edges, const cv::Mat1f& ranks, float shift, float parallax) {
  double sum = 0;
  std::size_t inside = 0;
  for (std::size_t i = 0; i < edges.places.size(); ++i) {
    const int x = cvRound(edges.places[i].x + shift + parallax * edges.inverse_depth[i]);
    if (x < 0 || x >= ranks.cols) continue;
    sum += ranks(cvRound(edges.places[i].y), x);
    ++inside;
  }
  return static_cast<double>(inside) < kStillInPicture * static_cast<double>(edges.places.size())
             ? std::numeric_limits<double>::quiet_NaN()
             : sum / static_cast<double>(inside);
}

struct Fit {
  double in_place = 0;         // best mean rank where the edges are, within the slack of a good rig
  double best = 0;             // of all shifts
  double mean = 0, sigma = 0;  // of all shifts
};

Fit fitOf(const DepthEdges& edges, const cv::Mat1f& ranks) {
  Fit fit;
  double sum = 0, squares = 0;
  int number = 0;
  for (int parallax = -kParallax; parallax <= kParallax; parallax += kStep) {
    for (int shift = -kShift; shift <= kShift; shift += kStep) {
      const double rank = meanRank(edges, ranks, static_cast<float>(shift), static_cast<float>(parallax));
      if (std::isnan(rank)) continue;
      fit.best = std::max(fit.best, rank);
      sum += rank;
      squares += rank * rank;
      ++number;
    }
  }
  for (int shift = -kSlack; shift <= kSlack; ++shift) {
    fit.in_place = std::max(fit.in_place, meanRank(edges, ranks, static_cast<float>(shift), 0));
  }
  fit.mean = sum / std::max(1, number);
  fit.sigma = std::sqrt(std::max(1e-12, squares / std::max(1, number) - fit.mean * fit.mean));
  return fit;
}

bool isAlike(const cv::Size& one, const cv::Size& other) {
  return std::abs(one.aspectRatio() / other.aspectRatio() - 1) <= 0.01;
}

bool isElongated(const cv::Size& size) {
  return std::max(size.width, size.height) > kMostElongated * std::min(size.width, size.height);
}

}  // namespace

std::string checkPose(const RigidTransform& depth_to_color) {
  const double distance = cv::norm(depth_to_color.translation_mm) / 1000;
  const auto degrees = [](double cosine) { return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / CV_PI; };
  const double angle = degrees((cv::trace(depth_to_color.rotation) - 1) / 2);
  const std::string where = cv::format(
      "the depth camera stands %.4g m from the colour camera, rotated by %.3g degrees", distance, angle);
  if (distance > kFarApart) return where + ": are these mm?";
  if (degrees(depth_to_color.rotation(2, 2)) > kAxesApart) {
    return where + ": is it between the optical frames (Z forward, Y down), and the quaternion x, y, z, w?";
  }
  return "";
}

std::string checkDepthUnit(const cv::Mat& depth) {
  const int known = cv::countNonZero(depth);
  const auto is_half = [&](int mm) { return 2 * cv::countNonZero(depth > mm) <= known; };
  if (known == 0 || !is_half(kProbablyMetres)) return "";
  int median = 1;
  while (!is_half(median)) ++median;
  return cv::format("half of the depths are %d or less: m, but a depth image means mm: multiply by 1000",
                    median);
}

double coverage(const cv::Mat& registered, const Rig& rig) {
  // In cells: where the colour camera has the finer pixels, single points do not cover it.
  const double pitch = std::sqrt(kSamplesPerCell) * rig.color.fx / rig.depth.fx;
  const int cell = std::max(1, static_cast<int>(std::ceil(pitch)));
  const cv::Size cells((registered.cols + cell - 1) / cell, (registered.rows + cell - 1) / cell);
  cv::Mat1b occupied(cells, 0);
  for (int y = 0; y < registered.rows; ++y) {
    const auto* row = registered.ptr<std::uint16_t>(y);
    auto* to = occupied[y / cell];
    for (int x = 0; x < registered.cols; ++x) {
      if (row[x] > 0) to[x / cell] = 1;
    }
  }
  return static_cast<double>(cv::countNonZero(occupied)) / cells.area();
}

std::string checkCoverage(const cv::Mat& registered, const Rig& rig) {
  // Nearly always this quick check is enough.
  if (cv::countNonZero(registered) >= kLittleCoverage * static_cast<double>(registered.total())) return "";
  const double share = coverage(registered, rig);
  if (share == 0) {
    throw std::invalid_argument(
        "no depth falls into the colour picture: check the transform and both calibrations");
  }
  if (share >= kLittleCoverage) return "";
  return cv::format(
      "only %.2g %% of the colour picture gets a depth: "
      "check the transform and both calibrations, and whether the sensor sees the scene",
      100 * share);
}

std::string checkPrincipalPoint(const Camera& camera, const char* name) {
  const auto is_central = [](double center, int length) {
    return std::abs(center - (length - 1) / 2.0) <= length / 4.0;
  };
  if (is_central(camera.cx, camera.size.width) && is_central(camera.cy, camera.size.height)) return "";
  return cv::format(
      "the principal point of the %s camera, %.4g, %.4g, is not in the middle half of its %dx%d pictures: is "
      "the "
      "calibration that of these pictures (binning, region of interest)?",
      name, camera.cx, camera.cy, camera.size.width, camera.size.height);
}

std::string checkCircleOfConfusion(const Optics& optics, const Camera& color) {
  const double sensor_mm = optics.focal_length_mm * color.size.width / color.fx;
  if (optics.circle_of_confusion_mm <= sensor_mm / 50) return "";
  return cv::format(
      "the circle of confusion, %g mm, is over a fiftieth of the sensor, which is %.3g mm wide: is it in "
      "another unit?",
      optics.circle_of_confusion_mm, sensor_mm);
}

std::string checkMirroring(const cv::Mat& registered, const cv::Mat& mirrored, const cv::Mat& picture) {
  if (registered.empty() || picture.empty() || registered.type() != CV_16UC1 || picture.type() != CV_8UC3 ||
      isElongated(picture.size()) || !isAlike(registered.size(), picture.size()))
    return "";
  const DepthEdges edges = findEdges(registered);
  const DepthEdges flipped = mirrored.empty() ? edges.mirrored() : findEdges(mirrored);
  if (edges.places.empty() || flipped.places.empty()) return "";
  const cv::Mat1f ranks = rankOfGradient(picture);
  const Fit straight = fitOf(edges, ranks);
  if (straight.in_place > straight.mean + kFitsSomewhere * straight.sigma) return "";
  const Fit mirror = fitOf(flipped, ranks);
  const bool is_mirrored = mirrored.empty() ? mirror.best > mirror.mean + kFitsSomewhere * mirror.sigma &&
                                                  mirror.best > straight.best + kClearlyBetter
                                            : mirror.in_place > mirror.mean + kFitsInPlace * mirror.sigma &&
                                                  mirror.in_place > straight.in_place + kClearlyBetter;
  if (!is_mirrored) return "";
  return "the edges of the depth image fit the picture better when it is mirrored: "
         "turn off mirroring where the depth comes from";
}

}  // namespace all_in_focus::core
