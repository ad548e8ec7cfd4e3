// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/region_fusion.hpp"

#include <algorithm>
#include <cstring>

namespace all_in_focus::core {
namespace {

// The sums of a run fit 32 bits up to 66051 pixels (65025 = 255^2).
constexpr int kMaxRun = 65536;

void addRun(const std::uint8_t* gray, int length, GraySums& sums) {
  std::uint32_t sum = 0, sum_of_squares = 0;
  for (int i = 0; i < length; ++i) {
    const std::uint32_t g = gray[i];
    sum += g;
    sum_of_squares += g * g;
  }
  sums.n += length;
  sums.sum += sum;
  sums.sum_of_squares += sum_of_squares;
}

}  // namespace

double normalizedVariance(const GraySums& sums) {
  if (sums.n == 0 || sums.sum == 0) return 0;
  // n mu = S. With S = q n + r, sum (I - mu)^2 = sum (I - q)^2 - r^2 / n: exact integers, so that a flat
  // region gives 0.
  const std::uint64_t q = sums.sum / sums.n, r = sums.sum % sums.n;
  const double about_q = static_cast<double>(sums.sum_of_squares + q * q * sums.n - 2 * q * sums.sum);
  const double remainder = static_cast<double>(r);
  return (about_q - remainder * remainder / static_cast<double>(sums.n)) / static_cast<double>(sums.sum);
}

void RegionFusion::begin(const cv::Mat& labels) {
  size_ = labels.size();
  image_.create(size_, CV_8UC3);
  image_.setTo(cv::Scalar::all(0));

  runs_.clear();
  for (int y = 0; y < labels.rows; ++y) {
    const auto* row = labels.ptr<std::int32_t>(y);
    for (int x = 0; x < labels.cols;) {
      const int begin = x, label = row[x];
      while (++x < labels.cols && row[x] == label && x - begin < kMaxRun) {
      }
      runs_.push_back({y, begin, x, label});
    }
  }
  // Labels may be any numbers (label maps of other programs): regions are their ranks among those that occur.
  regions_.clear();
  std::vector<int> known;
  known.reserve(runs_.size());
  for (const Run& run : runs_) known.push_back(run.region);
  std::sort(known.begin(), known.end());
  known.erase(std::unique(known.begin(), known.end()), known.end());
  for (const int label : known) regions_.push_back({label});
  for (Run& run : runs_) {
    run.region = static_cast<int>(std::lower_bound(known.begin(), known.end(), run.region) - known.begin());
  }
}

void RegionFusion::add(const cv::Mat& frame, const cv::Mat& gray, int index) {
  sums_.assign(regions_.size(), {});
  for (const Run& run : runs_) addRun(gray.ptr(run.y) + run.begin, run.end - run.begin, sums_[run.region]);

  bool any_won = false;
  for (std::size_t r = 0; r < regions_.size(); ++r) {
    Region& region = regions_[r];
    const double score = normalizedVariance(sums_[r]);
    region.won = score > region.best;
    if (region.won) {
      region.second = region.best;
      region.best = score;
      region.frame = index;
      any_won = true;
    } else {
      region.second = std::max(region.second, score);
    }
  }
  if (!any_won) return;

  if (image_.type() != frame.type()) image_ = cv::Mat::zeros(size_, frame.type());  // the first one
  const std::size_t bytes = frame.elemSize();
  for (const Run& run : runs_) {
    if (!regions_[run.region].won) continue;
    std::memcpy(image_.ptr(run.y) + run.begin * bytes, frame.ptr(run.y) + run.begin * bytes,
                (run.end - run.begin) * bytes);
  }
}

double RegionFusion::margin(const Region& region) const {
  if (region.second < 0) return 1;
  return region.best > 0 ? 1 - region.second / region.best : 0;
}

template <typename Pixel, typename Value>
cv::Mat RegionFusion::paint(int type, Value value) const {
  std::vector<Pixel> values(regions_.size());
  std::transform(regions_.begin(), regions_.end(), values.begin(), value);
  cv::Mat painted(size_, type);
  for (const Run& run : runs_) {
    auto* row = painted.ptr<Pixel>(run.y);
    std::fill(row + run.begin, row + run.end, values[run.region]);
  }
  return painted;
}

cv::Mat RegionFusion::sourceIndex() const {
  return paint<std::uint16_t>(CV_16UC1,
                              [](const Region& region) { return static_cast<std::uint16_t>(region.frame); });
}

cv::Mat RegionFusion::confidence() const {
  return paint<std::uint8_t>(CV_8UC1, [this](const Region& region) {
    return static_cast<std::uint8_t>(255 * margin(region) + 0.5);
  });
}

std::vector<RegionChoice> RegionFusion::choices() const {
  std::vector<RegionChoice> choices;
  for (const Region& region : regions_) {
    choices.push_back(
        {region.label, region.frame, std::max(region.best, 0.0), margin(region), margin(region)});
  }
  return choices;
}

}  // namespace all_in_focus::core
