// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "optics/focus_votes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "util/median.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kMostColumns = 1280;  // of a picture; a larger one is shrunk
constexpr int kCell = 4;            // px of it
constexpr int kTile = 4;            // cells
constexpr int kUnits = 8;           // a gray level

constexpr int kSamples = 4;              // of depth, along a side of a tile
constexpr double kLeastMeasured = 0.75;  // of them
constexpr double kFlat = 0.1;            // span of inverse depth over its mean, in a tile of one surface

// A tile votes if it is sharper by this factor than in the first and the last frame. Else noise decides, or
// it may be sharper beyond the ends.
constexpr double kStandsOut = 1.28;
constexpr double kOfNoise = 0.5;           // mean detail of noise, of which so much is added
constexpr double kFewestShowDetail = 0.1;  // share of tiles in which some frame shows noise alone

// Measured on 36 scenes: a right list has 0.6 to 0.94; one that is late or early by a frame at most 0.16.
constexpr std::size_t kLeastVotes = 12;
constexpr double kAgree = 0.5, kSurelyAgree = 0.6;
constexpr double kOpposed = -0.5;  // correlation of depth and focus
constexpr double kAsGood = 0.05;

constexpr double kLeastFactor = 1.05;         // what is less may be the depth sensor's
constexpr int kPerDecade = 64, kDecades = 3;  // factors that are tried

constexpr double kShortest = 2;  // frames between the votes of the quarters that are nearest and farthest

// Whether the focus moves in one direction.
bool isSweep(const std::vector<FrameBlur>& list) {
  for (std::size_t k = 2; k < list.size(); ++k) {
    if ((list[k].inverse_depth - list[k - 1].inverse_depth) *
            (list[k - 1].inverse_depth - list[k - 2].inverse_depth) <
        0)
      return false;
  }
  return list.size() > 2;
}

// Inverse focus distance between frames of a list.
double between(const std::vector<FrameBlur>& list, double place) {
  const auto below = std::min(static_cast<std::size_t>(place), list.size() - 2);
  const double share = place - static_cast<double>(below);
  return (1 - share) * list[below].inverse_depth + share * list[below + 1].inverse_depth;
}

// Inverse depth of a tile; 0 where little is known of it, or where it holds several surfaces.
float surfaceIn(const cv::Mat1w& depth, const cv::Rect2d& tile) {
  std::vector<double> known;
  known.reserve(kSamples * kSamples);
  double least = 1, largest = 0;
  for (int j = 0; j < kSamples; ++j) {
    for (int i = 0; i < kSamples; ++i) {
      const int y = static_cast<int>(tile.y + (j + 0.5) / kSamples * tile.height);
      const int x = static_cast<int>(tile.x + (i + 0.5) / kSamples * tile.width);
      const std::uint16_t mm = depth(std::min(y, depth.rows - 1), std::min(x, depth.cols - 1));
      if (mm == 0) continue;
      known.push_back(1.0 / mm);
      least = std::min(least, known.back());
      largest = std::max(largest, known.back());
    }
  }
  if (static_cast<double>(known.size()) < kLeastMeasured * kSamples * kSamples) return 0;
  const double middle = median(std::move(known));
  return largest - least < kFlat * middle ? static_cast<float>(middle) : 0;
}

}  // namespace

double FocusVotes::Vote::at(const std::vector<FrameBlur>& list) const {
  return (between(list, from) + between(list, to)) / 2;
}

DetailMap DetailMap::of(const cv::Mat& gray) {
  const int shrink = std::max(1, cvRound(static_cast<double>(gray.cols) / kMostColumns));
  DetailMap map;
  map.cell = kCell * shrink;
  cv::Mat small = gray, laplacian;
  const cv::Size size(gray.cols / shrink, gray.rows / shrink);
  const cv::Size grid(size.width / kCell, size.height / kCell);
  if (grid.empty()) return map;
  if (shrink > 1) cv::resize(gray, small, size, 0, 0, cv::INTER_AREA);
  cv::Laplacian(small, laplacian, CV_16S, 1, kUnits);
  laplacian = cv::abs(laplacian);
  cv::resize(laplacian(cv::Rect({}, grid * kCell)), map.cells, grid, 0, 0, cv::INTER_AREA);
  return map;
}

FocusVotes::FocusVotes(const std::vector<Frame>& frames, const cv::Mat& depth, const cv::Size& size) {
  if (frames.size() < 3 || frames[0].detail.cells.empty()) return;
  const int side = kTile * frames[0].detail.cell;  // px, of a tile
  const cv::Size grid(size.width / side, size.height / side);
  const double x_scale = static_cast<double>(depth.cols) / size.width,
               y_scale = static_cast<double>(depth.rows) / size.height;
  struct Tile {
    float inverse_depth;
    std::vector<double> detail;  // by frame
  };
  std::vector<Tile> tiles;
  std::vector<double> least;
  for (int v = 0; v < grid.height; ++v) {
    for (int u = 0; u < grid.width; ++u) {
      const cv::Point2d corner(u * side, v * side);
      Tile tile;
      tile.inverse_depth =
          surfaceIn(depth, {corner.x * x_scale, corner.y * y_scale, side * x_scale, side * y_scale});
      if (tile.inverse_depth == 0) continue;
      tile.detail.reserve(frames.size());
      const cv::Point2d middle = corner + cv::Point2d(side, side) / 2;
      for (const Frame& frame : frames) {
        const cv::Vec2d moved = frame.motion * cv::Vec3d(middle.x, middle.y, 1);
        const cv::Point2d there =
            (cv::Point2d(moved[0], moved[1]) - cv::Point2d(side, side) / 2) / frame.detail.cell;
        const cv::Rect cells(cvRound(there.x), cvRound(there.y), kTile, kTile);
        if ((cells & cv::Rect({}, frame.detail.cells.size())) != cells) break;
        tile.detail.push_back(frame.gain / kUnits * cv::mean(frame.detail.cells(cells))[0]);
      }
      if (tile.detail.size() < frames.size()) continue;  // a frame has not seen it
      least.push_back(*std::min_element(tile.detail.begin(), tile.detail.end()));
      tiles.push_back(std::move(tile));
    }
  }
  if (tiles.empty()) return;
  const auto lowest =
      least.begin() + static_cast<std::ptrdiff_t>(kFewestShowDetail * static_cast<double>(least.size()));
  std::nth_element(least.begin(), lowest, least.end());
  const double noise = kOfNoise * (*lowest + 1);  // rounding is noise, too
  for (const Tile& tile : tiles) {
    const auto top = std::max_element(tile.detail.begin(), tile.detail.end());
    // Blur of less than a pixel does not show: several frames may be as sharp. So the vote lies in the middle
    // of where sharpness falls below the level, on either side.
    const double level = (*top + noise) / kStandsOut - noise;
    if (std::max(tile.detail.front(), tile.detail.back()) > level) continue;
    const auto crossing = [&](int direction) {
      auto beyond = top;
      while (*beyond > level) beyond += direction;
      const auto within = beyond - direction;
      const double share = (*within - level) / (*within - *beyond);
      return static_cast<float>(static_cast<double>(within - tile.detail.begin()) + direction * share);
    };
    votes_.push_back({crossing(-1), crossing(1), tile.inverse_depth});
  }
}

double FocusVotes::support(const std::vector<FrameBlur>& list) const {
  if (votes_.empty()) return 0;
  std::vector<double> steps;
  for (std::size_t k = 1; k < list.size(); ++k)
    steps.push_back(std::abs(list[k].inverse_depth - list[k - 1].inverse_depth));
  const double step = std::max(median(std::move(steps)), 1e-12);
  double sum = 0;
  for (const Vote& vote : votes_)
    sum += std::max(0.0, 1 - std::abs(vote.at(list) - vote.inverse_depth) / step);
  return sum / static_cast<double>(votes_.size());
}

bool FocusVotes::areReversed(const std::vector<FrameBlur>& list) const {
  cv::Vec2d sum;
  for (const Vote& vote : votes_) sum += cv::Vec2d(vote.at(list), vote.inverse_depth);
  const cv::Vec2d mean = sum / static_cast<double>(votes_.size());
  double xx = 0, xy = 0, yy = 0;
  for (const Vote& vote : votes_) {
    const double x = vote.at(list) - mean[0], y = vote.inverse_depth - mean[1];
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  return xy < kOpposed * std::sqrt(xx * yy);
}

// On the distances, by which the votes agree with them.
double FocusVotes::bestFactor(const std::vector<FrameBlur>& list) const {
  const auto by = [](double factor) { return FocusCorrection{false, 0, factor}; };
  double best = 1, most = support(list);
  for (int i = -kDecades * kPerDecade; i <= kDecades * kPerDecade; ++i) {
    const double factor = std::pow(10, static_cast<double>(i) / kPerDecade);
    const double agree = support(by(factor).of(list));
    if (agree <= most) continue;
    best = factor;
    most = agree;
  }
  std::vector<double> exact;  // of the votes that agree
  for (const Vote& vote : votes_) {
    const double factor = vote.at(list) / vote.inverse_depth;
    if (std::abs(std::log(factor / best)) < std::log(10.0) / kPerDecade * 3) exact.push_back(factor);
  }
  return exact.empty() ? best : median(std::move(exact));
}

std::optional<FocusCorrection> FocusVotes::correctionOf(const std::vector<FrameBlur>& list) const {
  if (votes_.size() < kLeastVotes || !isSweep(list)) return std::nullopt;
  if (support(list) >= kAgree) return FocusCorrection();
  if (areReversed(list)) return FocusCorrection{true, 0, 1};
  FocusCorrection best;
  double most = 0;
  // The more common mistakes first: a later one must agree better.
  for (const FocusCorrection& focus : {FocusCorrection{false, 1, 1}, FocusCorrection{false, -1, 1},
                                       FocusCorrection{false, 0, bestFactor(list)}}) {
    const double agree = support(focus.of(list));
    if (agree < most + kAsGood) continue;
    best = focus;
    most = agree;
  }
  if (most < kSurelyAgree) return std::nullopt;
  if (best.shift == 0 && std::max(best.factor, 1 / best.factor) < kLeastFactor) return FocusCorrection();
  return best;
}

// The straight line through the votes by the median of slopes (Theil), each between a vote and that which
// lies half of all votes farther. Depth is exact, places are not: so places are a function of depth.
std::vector<double> FocusVotes::focusAt(const std::vector<double>& steps) const {
  if (votes_.size() < kLeastVotes) return {};
  std::vector<FrameBlur> list;
  list.reserve(steps.size());
  for (const double step : steps) list.push_back({step, 1});
  std::vector<cv::Point2d> votes;  // inverse depth, step
  for (const Vote& vote : votes_) votes.emplace_back(vote.inverse_depth, vote.at(list));
  std::sort(votes.begin(), votes.end(), [](const auto& a, const auto& b) { return a.x < b.x; });
  std::vector<double> slopes, offsets;
  const std::size_t half = votes.size() / 2;
  for (std::size_t i = 0; i + half < votes.size(); ++i) {
    const cv::Point2d apart = votes[i + half] - votes[i];
    if (apart.x > 0) slopes.push_back(apart.y / apart.x);
  }
  const double slope = median(std::move(slopes));
  for (const cv::Point2d& vote : votes) offsets.push_back(vote.y - slope * vote.x);
  const double offset = median(std::move(offsets));
  const double nearest = votes[votes.size() - 1 - votes.size() / 8].x, farthest = votes[votes.size() / 8].x;
  if (std::abs(slope) * (nearest - farthest) < kShortest) return {};
  std::vector<double> focus;
  for (FrameBlur& frame : list) {
    frame.inverse_depth = (frame.inverse_depth - offset) / slope;
    focus.push_back(frame.inverse_depth);
  }
  return support(list) >= kSurelyAgree ? focus : std::vector<double>();
}

}  // namespace all_in_focus::core
