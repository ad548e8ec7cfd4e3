// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "fusion/noise_estimation.hpp"

namespace all_in_focus::core {

/// How sharp a frame is at every scale, pixel by pixel:
///   t_0 t_1 (t_2 t_3 ...)^(3/4),  t_l = sqrt(s_l^2 + n_l^2)  at level l of a Gaussian pyramid,
/// s_l the modified Laplacian |I_xx| + |I_yy| (Nayar and Nakagawa 1994) of that level in a Gaussian window,
/// each level upsampled to the size of the one below it; n_l = 0.6^l (1.7 + 12 sigma), sigma the deviation of
/// the noise, so that frames which differ by noise alone are about as sharp. Fine texture is measured at the
/// finest level. The coarser ones measure what is flat there; they reach farther, across thin things, too, so
/// those from level 2 on count a little less. They also reach across depth edges, so where depth predicts the
/// blur (`predicted`), the product of the coarser ones counts by its square root (of level 2 and coarser
/// ones: instead of by the power 3/4). In pictures of 1810 px width and more the first of these is the level
/// that is finer by one than textureLevel(), because depth edges are uncertain by more pixels there.
///
/// s_0 of a `resampled` frame is multiplied by 0.85: resampling takes away the finest detail, and its errors
/// look like detail.
///
/// Where `brightness` is known, t_0 is multiplied by (20 / (20 + v))^1.5, v the brightness of the pixel.
///
/// Near `lights` s_l would grow with the blur. There it is at most 3 gray levels, at levels from 1 on that
/// are no more than 1.5 times as wide as the map of the lights.
///
/// With `trust` the product is multiplied by min(1, m / (4 + noise)), m the fourth root of the mean of s_t^4,
/// less that of the noise: on bare surfaces far from all texture, where no scale tells frames apart, those
/// that are sharp nowhere hardly count. They would spread the light of blurred things there. t is
/// textureLevel(), so that pixels without detail change nothing.
///
/// Level 0 is never held as a whole; all others together take a third of the pixels of one frame.
class SharpnessPyramid {
 public:
  /// What a frame is measured by.
  struct Gauge {
    NoiseSpectrum noise;
    bool scales = true;      ///< false: level 0 alone, for comparison
    bool trust = false;      ///< count a frame that is sharp nowhere as hardly sharp everywhere
    cv::Mat predicted{};     ///< CV_8UC1, any size; not 0: depth predicts the blur there; empty: nowhere
    bool resampled = false;  ///< the frame was brought into the geometry of another
    cv::Mat brightness{};    ///< CV_8UC1, see brightnessOf(); empty: does not count
    cv::Mat lights{};        ///< CV_8UC1, see clippedLights(), the same for all frames; empty: none
  };

  /// Level 1 of a picture 640 px wide, and the level of that size in a larger one.
  static std::size_t textureLevel(int width);

  /// gray: CV_8UC1 in the exposure of the reference, not empty; must outlive the rows.
  void begin(const cv::Mat& gray, const Gauge& gauge);

  /// The product in some rows, > 0. Products stay below 1e38 for frames of up to a gigapixel.
  cv::Mat1f compute(const cv::Range& rows) const;

  /// s_l of the frame at textureLevel(), or at the coarsest level, CV_32FC1; empty if there is only
  /// one.
  const cv::Mat& texture() const { return texture_; }

 private:
  void addLevel(const cv::Mat1f& image, size_t level, bool is_texture);
  float trust(double noise) const;

  cv::Mat1b gray_;
  Gauge gauge_;
  float trust_ = 1;
  cv::Mat1f product_;  ///< of all coarser levels than the present one; empty: there are none
  cv::Mat1f texture_;
};

}  // namespace all_in_focus::core
