// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/hole_filling.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

void requireDepth(const cv::Mat& depth) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("hole filling: depth must be CV_16UC1 mm and not empty");
  }
}

constexpr std::uint16_t kOpen = 0xFFFF;  // width of a hole that reaches the left or right border

// Number of threads that an image is worth.
int threadCount(const cv::Mat& image) {
  constexpr int kMinPixelsPerThread = 64 * 1024;
  return std::max(1, std::min(cv::getNumThreads(), static_cast<int>(image.total()) / kMinPixelsPerThread));
}

// Bit i is set if depth[i] < limit, for at most 64 pixels.
std::uint64_t below(const std::uint16_t* depth, int count, std::uint16_t limit) {
  const cv::v_uint16x8 limits = cv::v_setall_u16(limit);
  std::uint64_t bits = 0;
  int i = 0;
  for (; i < std::min(64, count - 15); i += 16) {
    const std::uint64_t of_16 =
        cv::v_signmask(cv::v_pack(cv::v_load(depth + i) < limits, cv::v_load(depth + i + 8) < limits));
    bits |= of_16 << i;
  }
  for (; i < std::min(64, count); ++i) bits |= static_cast<std::uint64_t>(depth[i] < limit) << i;
  return bits;
}

// Calls body(i) for each bit i.
template <typename Body>
void forEachBit(std::uint64_t bits, const Body& body) {
  for (; bits != 0; bits &= bits - 1) body(__builtin_ctzll(bits));
}

}  // namespace

void dilateDepth(const cv::Mat& depth, cv::Mat& dilated) {
  requireDepth(depth);
  cv::dilate(depth, dilated, cv::Mat());
}

// Tabulates C d (equations 5 and 6) for whole mm. From 8 K on it is below 1e-25 mm, and taken for 0.
void DiffusionFilling::tabulateFlows() {
  if (conduction_mm == tabulated_conduction_mm_) return;
  reach_ = static_cast<int>(std::min(65535.0, 8 * conduction_mm)) + 1;
  flows_.assign(2 * reach_ + 1, 0);
  for (int d = 1 - reach_; d < reach_; ++d) {
    flows_[d + reach_] = std::exp(-(d / conduction_mm) * (d / conduction_mm)) * d;
  }
  tabulated_conduction_mm_ = conduction_mm;
}

void DiffusionFilling::fill(cv::Mat& depth) {
  requireDepth(depth);
  if (!(conduction_mm > 0)) throw std::invalid_argument("hole filling: the conduction K must be positive");
  if (!(lambda >= 0 && lambda <= 0.25)) {  // more would give depths that no neighbour has
    throw std::invalid_argument(cv::format("hole filling: lambda must be 0 to 0.25, not %g", lambda));
  }
  if (hole_below_mm <= 0 || hole_below_mm > 65535) return;  // no pixel is a hole, or all are
  tabulateFlows();
  const int reach = reach_;
  const double* const flows = flows_.data();
  const unsigned last = 2 * reach;
  const double step = lambda;
  const auto flow = [&](int neighbour, int here) {
    const auto index = static_cast<unsigned>(neighbour - here + reach);
    return index <= last ? flows[index] : 0.0;
  };
  const auto limit = static_cast<std::uint16_t>(hole_below_mm);
  for (int i = 3; i < depth.rows; ++i) {
    std::uint16_t* const row = depth.ptr<std::uint16_t>(i);
    const std::uint16_t* const above =
        depth.ptr<std::uint16_t>(i - 2);  // I(i-2, .) takes the place of I(i, .)
    const std::uint16_t* const north = depth.ptr<std::uint16_t>(i - 3);
    const std::uint16_t* const south = depth.ptr<std::uint16_t>(i - 1);
    for (int begin = 0; begin < depth.cols; begin += 64) {
      const int count = depth.cols - begin;
      const std::uint64_t holes = below(row + begin, count, limit);
      if (holes == 0) continue;
      forEachBit(holes & ~below(above + begin, count, limit), [&](int bit) {
        const int j = begin + bit, here = above[j];
        const int west = above[std::max(j - 1, 0)], east = above[std::min(j + 1, depth.cols - 1)];
        const double sum =
            flow(north[j], here) + flow(south[j], here) + flow(west, here) + flow(east, here);  // equation 8
        row[j] = static_cast<std::uint16_t>(here + step * sum + 0.5);                           // equation 7
      });
    }
  }
}

void FarSideFilling::fill(const cv::Mat& depth, cv::Mat& filled) {
  requireDepth(depth);
  filled.create(depth.size(), CV_16UC1);
  width_.create(depth.size());
  const int count = threadCount(depth);
  bands_.resize(count);
  const RowStrips strips({0, depth.rows}, count);
  strips.forEach([&](const cv::Range& rows, int i) { fillBand(depth, rows, bands_[i], filled); });
  // Holes that reach across bands, column by column.
  for (int j = 0; count > 1 && j < depth.cols; ++j) {
    int begin = bands_[0].begin[j];
    for (int i = 1; i < count; ++i) {
      const bool goes_on = depth.at<std::uint16_t>(strips[i].start - 1, j) == 0;
      const int end = bands_[i].end[j];
      if (goes_on && end == 0) continue;  // the hole goes through the whole band
      if (goes_on && begin > 0) fillDown(depth, j, begin, end, filled);
      begin = bands_[i].begin[j];
    }
  }
}

void FarSideFilling::fillBand(const cv::Mat& depth, const cv::Range& rows, Band& band, cv::Mat& filled) {
  const int cols = depth.cols, words = (cols + 63) / 64;
  band.holes.assign(words, 0);
  band.begin.assign(cols, 0);
  band.end.assign(cols, 0);
  for (int word = 0; rows.start > 0 && word < words; ++word) {
    band.holes[word] = below(depth.ptr<std::uint16_t>(rows.start - 1) + 64 * word, cols - 64 * word, 1);
  }
  for (int i = rows.start; i < rows.end; ++i) {
    const auto* const row = depth.ptr<std::uint16_t>(i);
    std::copy_n(row, cols, filled.ptr<std::uint16_t>(i));
    std::uint64_t carry = 0;  // 1 if the pixel before this word is a hole
    int begin = 0;
    for (int word = 0; word < words; ++word) {
      const int first = 64 * word;
      const std::uint64_t here = below(row + first, cols - first, 1), above = band.holes[word];
      forEachBit(here ^ (here << 1 | carry), [&](int bit) {
        if (here >> bit & 1) {
          begin = first + bit;
        } else {
          fillAcross(row, cols, begin, first + bit, i, filled);
        }
      });
      carry = here >> 63;
      forEachBit(here & ~above, [&](int bit) { band.begin[first + bit] = static_cast<std::uint16_t>(i); });
      forEachBit(above & ~here, [&](int bit) {
        const int j = first + bit;
        if (band.begin[j] > 0) {
          fillDown(depth, j, band.begin[j], i, filled);
        } else {
          band.end[j] = static_cast<std::uint16_t>(i);
        }
      });
      band.holes[word] = here;
    }
    if (carry != 0) fillAcross(row, cols, begin, cols, i, filled);
  }
}

// Fills the hole in columns begin..end-1 of row i.
void FarSideFilling::fillAcross(const std::uint16_t* row, int cols, int begin, int end, int i,
                                cv::Mat& filled) {
  const bool closed = begin > 0 && end < cols;
  const std::uint16_t across = closed ? std::max(row[begin - 1], row[end]) : 0;
  std::fill_n(filled.ptr<std::uint16_t>(i) + begin, end - begin, across);
  std::fill_n(width_[i] + begin, end - begin, closed ? static_cast<std::uint16_t>(end - begin) : kOpen);
}

// Fills the hole in rows begin..end-1 of a column, at those pixels where it is wider than high.
void FarSideFilling::fillDown(const cv::Mat& depth, int column, int begin, int end, cv::Mat& filled) {
  const std::uint16_t farther =
      std::max(depth.at<std::uint16_t>(begin - 1, column), depth.at<std::uint16_t>(end, column));
  for (int i = begin; i < end; ++i) {
    if (end - begin < width_(i, column)) filled.at<std::uint16_t>(i, column) = farther;
  }
}

}  // namespace all_in_focus::core
