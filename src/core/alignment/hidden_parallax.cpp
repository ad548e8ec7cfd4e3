// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/hidden_parallax.hpp"

#include <algorithm>
#include <cmath>

#include "alignment/alignment_parameters.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kCells = CellShifts::kAcross * CellShifts::kDown;
constexpr double kNothing = 1e-9;  // 1/px^2, a prior: less than any texture tells

// Pulls of one cell in all pairs lie in a column.
struct Pulls {
  cv::Mat1d x, y;
  std::vector<std::vector<cv::Matx22d>> information;  // of each pair

  int pairs() const { return x.rows; }
  cv::Vec2d of(int pair, int cell) const { return {x(pair, cell), y(pair, cell)}; }
};

cv::Matx22d informationOf(const CellShifts::Cell& cell) {
  return {cell.xx, cell.xy, cell.xy, cell.yy};
}

// Takes from a pair what a similarity transform and a turn of the camera explain, robustly, and puts the rest
// into row `pair` of the pulls. aspect: height of the picture over its width.
void explain(const CellShifts& shifts, double aspect, int pair, Pulls& pulls) {
  using Numbers = cv::Vec<double, 6>;
  std::array<cv::Matx<double, 2, 6>, kCells> derivative;
  for (int i = 0; i < kCells; ++i) {
    const int column = i % CellShifts::kAcross, row = i / CellShifts::kAcross;
    const double x = (column + 0.5) / CellShifts::kAcross - 0.5,
                 y = ((row + 0.5) / CellShifts::kDown - 0.5) * aspect;
    derivative[i] = {x, -y, 1, 0, x * x, x * y, y, x, 0, 1, x * y, y * y};
  }
  std::vector<double> weights(kCells, 1);
  constexpr int kIterations = 3;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    cv::Matx<double, 6, 6> information = kNothing * cv::Matx<double, 6, 6>::eye();
    Numbers gradient;
    for (int i = 0; i < kCells; ++i) {
      const CellShifts::Cell& cell = shifts.cells[i];
      const cv::Matx<double, 6, 2> slope = weights[i] * derivative[i].t();
      information += slope * informationOf(cell) * derivative[i];
      gradient += slope * cv::Vec2d(cell.x, cell.y);
    }
    const Numbers motion = information.inv(cv::DECOMP_CHOLESKY) * gradient;
    for (int i = 0; i < kCells; ++i) {
      const CellShifts::Cell& cell = shifts.cells[i];
      const cv::Matx22d of_cell = informationOf(cell);
      const cv::Vec2d pull = cv::Vec2d(cell.x, cell.y) - of_cell * (derivative[i] * motion);
      const double squared =
          pull.dot((of_cell + (kNothing + 1e-6 * cv::trace(of_cell)) * cv::Matx22d::eye()).inv() * pull);
      weights[i] = 1 / std::sqrt(std::max(1.0, squared));  // Huber
      pulls.x(pair, i) = weights[i] * pull[0];
      pulls.y(pair, i) = weights[i] * pull[1];
      pulls.information[pair][i] = weights[i] * of_cell;
    }
  }
}

// Neighbours are in the same half, for they err alike.
bool isInFirstHalf(int cell) {
  constexpr int kBlock = 2;
  return (cell % CellShifts::kAcross / kBlock + cell / CellShifts::kAcross / kBlock) % 2 == 0;
}

// Without BLAS: where memory is short, OpenBLAS waits for its buffer of 128 MB for ever.
cv::Mat1d product(const cv::Mat1d& a, const cv::Mat1d& b) {
  cv::Mat1d sums(a.rows, b.cols, 0.0);
  for (int row = 0; row < a.rows; ++row) {
    for (int k = 0; k < a.cols; ++k) {
      for (int column = 0; column < b.cols; ++column) sums(row, column) += a(row, k) * b(k, column);
    }
  }
  return sums;
}

// How much the path of each cell bends, positive: in the same sense as those of the other half.
std::vector<double> bends(const Pulls& pulls) {
  std::vector<double> result(kCells);
  for (const bool first : {true, false}) {
    // Areas between the shifts of a cell in any two pairs. Their sum over the cells of one half, x y^T - y
    // x^T, is antisymmetric; its greatest part is a plane, which `from` and `to` span.
    cv::Mat1d x = pulls.x.clone(), y = pulls.y.clone(), from, to;
    double longest = -1;
    for (int i = 0; i < kCells; ++i) {
      if (isInFirstHalf(i) == first) {
        x.col(i) = 0;
        y.col(i) = 0;
      }
      for (const cv::Mat1d& pull : {x, y}) {
        const double length = cv::norm(pull.col(i));
        if (length > longest) pull.col(i).copyTo(from);
        longest = std::max(longest, length);
      }
    }
    const cv::Mat1d x_transposed(x.t()), y_transposed(y.t());
    constexpr int kIterations = 20;
    for (int i = 0; i < kIterations; ++i) {
      if (i > 0) cv::swap(from, to);
      cv::normalize(from, from);
      to = product(x, product(y_transposed, from)) - product(y, product(x_transposed, from));
    }
    cv::normalize(to, to);
    const cv::Mat1d to_row(to.t()), from_row(from.t());
    const cv::Mat1d to_x = product(to_row, pulls.x), to_y = product(to_row, pulls.y),
                    from_x = product(from_row, pulls.x), from_y = product(from_row, pulls.y);
    for (int i = 0; i < kCells; ++i) {
      if (isInFirstHalf(i) == first) result[i] = to_x(0, i) * from_y(0, i) - to_y(0, i) * from_x(0, i);
    }
  }
  return result;
}

// The greatest translation of all pairs, px of a cell that is a standard deviation from the mean inverse
// depth, where the shift of each cell is its inverse depth times the translation. first: a cell.
double greatestTranslation(const Pulls& pulls, int first) {
  std::vector<double> relief(kCells), weight(kCells, 1);
  for (int f = 0; f < pulls.pairs(); ++f) {
    for (int i = 0; i < kCells; ++i) relief[i] += pulls.of(f, i).dot(pulls.of(f, first));
  }
  std::vector<cv::Vec2d> translation(pulls.pairs());
  double greatest = 0;
  constexpr int kIterations = 20;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    double deviation = kNothing, sum = kNothing;
    for (int i = 0; i < kCells; ++i) {
      deviation += weight[i] * relief[i] * relief[i];
      sum += weight[i];
    }
    for (double& value : relief) value /= std::sqrt(deviation / sum);
    greatest = 0;
    for (int f = 0; f < pulls.pairs(); ++f) {
      cv::Matx22d information = kNothing * cv::Matx22d::eye();
      cv::Vec2d pull;
      for (int i = 0; i < kCells; ++i) {
        information += relief[i] * relief[i] * pulls.information[f][i];
        pull += relief[i] * pulls.of(f, i);
      }
      translation[f] = information.inv() * pull;
      greatest = std::max(greatest, cv::norm(translation[f]));
    }
    for (int i = 0; i < kCells; ++i) {
      double pull = 0;
      weight[i] = kNothing;
      for (int f = 0; f < pulls.pairs(); ++f) {
        pull += translation[f].dot(pulls.of(f, i));
        weight[i] += translation[f].dot(pulls.information[f][i] * translation[f]);
      }
      relief[i] = pull / weight[i];
    }
  }
  return greatest;
}

}  // namespace

void CellShifts::add(double x, double y, const cv::Matx22d& information, const cv::Vec2d& pull,
                     double variance) {
  const cv::Matx22d less = (cv::Matx22d::eye() + variance * information).inv();
  const cv::Matx22d left = less * information;
  const cv::Vec2d left_pull = less * pull;
  const int column = std::clamp(static_cast<int>(x * kAcross), 0, kAcross - 1),
            row = std::clamp(static_cast<int>(y * kDown), 0, kDown - 1);
  Cell& cell = cells[static_cast<std::size_t>(row) * kAcross + column];
  cell.xx += static_cast<float>(left(0, 0));
  cell.xy += static_cast<float>(left(0, 1));
  cell.yy += static_cast<float>(left(1, 1));
  cell.x += static_cast<float>(left_pull[0]);
  cell.y += static_cast<float>(left_pull[1]);
}

double hiddenParallax(const std::vector<const CellShifts*>& pairs, const cv::Size& size) {
  const int count = static_cast<int>(pairs.size());
  if (count < 2) return 0;  // a path that bends has three places
  Pulls pulls{cv::Mat1d(count, kCells), cv::Mat1d(count, kCells),
              std::vector<std::vector<cv::Matx22d>>(count, std::vector<cv::Matx22d>(kCells))};
  for (int f = 0; f < count; ++f) explain(*pairs[f], static_cast<double>(size.height) / size.width, f, pulls);
  const std::vector<double> bend = bends(pulls);
  double sum = 0, squares = 0;
  for (const double value : bend) {
    sum += value;
    squares += value * value;
  }
  if (!(sum > kAlignment.bend_significance * std::sqrt(squares))) return 0;
  const auto strongest = static_cast<int>(std::max_element(bend.begin(), bend.end()) - bend.begin());
  const double parallax = 2 * greatestTranslation(pulls, strongest);
  return parallax >= kAlignment.noticeable ? parallax : 0;
}

}  // namespace all_in_focus::core
