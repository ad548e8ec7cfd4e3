// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// How reliable a row of a frame is, pixel by pixel.
struct EvidenceRow {
  const float* sharpness = nullptr;  ///< over all scales (SharpnessPyramid), > 0; never null
  const float* squared_error =
      nullptr;                  ///< that depth and optics predict, gray levels squared; null: nothing
  const float* part = nullptr;  ///< 0..1 of the frame that counts (BorderFade); null: all of it
};

/// Running weighted mean of frames, pixel by pixel, and which of them weighed most. Keeps a few numbers
/// per pixel, however many frames there are.
///
/// A frame weighs
///   sharpness^8 / (predicted squared error + 1/12 + 5 noise variances):
/// the inverse of the variance that is expected of it (1/12 is that of rounding), times a softmax, the power,
/// of what is seen. As such powers overflow, weights are kept in units of the greatest sharpness so far. Each
/// frame moves the mean by its share of all weights, so that no sum of colours is needed. Where only a part
/// of a frame counts, it moves the mean by that part of its share: a small weight would not do, because
/// weights of a sharp frame are many times those of others. The mean is rounded to 1/128 of a gray level: two
/// bytes instead of the four of a float, and 16-bit arithmetic. The mean of 16-bit frames is a float.
///
/// A frame of 640x480 takes 0.5 ms; the same as a sequence of OpenCV's operations, 32 rows at a time, 6.5 ms
/// (one thread).
class WeightedMean {
 public:
  struct Kind {
    bool soft = true;    ///< false: the frame that weighs most is copied, for comparison
    bool choice = true;  ///< false: no sourceIndex() and confidence(), whose sums are 6 of 20 bytes a pixel
    bool deep = false;   ///< frames have 16 bits
    bool steep = false;  ///< the power grows where there is little noise, up to 12
  };

  /// noise: standard deviation of the frames' noise in gray levels, >= 0.
  void begin(const cv::Size& size, double noise, const Kind& kind);

  /// The rows that follow are of this frame. lut: the value that each of its 8-bit values stands for, clamped
  /// to 0 .. 255.
  void beginFrame(int index, const std::array<float, 256>& lut);

  /// The same for frames of 16 bits, 65536 values.
  void beginFrame(int index, std::vector<float> lut);

  /// Adds row y. columns: those that the frame has seen; pixels: of the whole row, three codes each. Other
  /// threads may add other rows at the same time.
  void addRow(int y, const cv::Range& columns, const std::uint8_t* pixels, const EvidenceRow& evidence);
  void addRow(int y, const cv::Range& columns, const std::uint16_t* pixels, const EvidenceRow& evidence);

  cv::Mat image() const;                                        ///< CV_8UC3, deep: CV_16UC3
  const cv::Mat& sourceIndex() const { return source_index_; }  ///< CV_16UC1
  cv::Mat confidence() const;  ///< CV_8UC1: 255 (1 - mean weight / largest), scaled so that 255 = no rival

 private:
  template <typename Code>
  void addCodes(int y, const cv::Range& columns, const Code* pixels, const EvidenceRow& evidence);
  void chooseShares(const float* keep, const float* weight, const cv::Point& at, int n, const float* part,
                    float* share);
  void move(const float* share, const std::uint8_t* pixels, const cv::Point& at, int n);
  void move(const float* share, const std::uint16_t* pixels, const cv::Point& at, int n);

  bool soft_ = true, choice_ = true;
  int frames_ = 0;
  float steep_ = 0;  // 0: power 8, 1: power 12
  float error_floor_ = 1;
  std::uint16_t index_ = 0;            // of the frame being added
  std::array<std::int16_t, 256> lut_;  // in units of mean_
  bool plain_ = true;                  // the LUT changes nothing
  std::vector<float> deep_lut_;        // the same for frames of 16 bits
  cv::Mat mean_;      // CV_16SC3, 128 times the gray level (hard: of the heaviest frame); deep: CV_32FC3
  cv::Mat sharpest_;  // CV_32FC1: greatest sharpness; a weight of 1 is its 8th power
  cv::Mat weights_;   // CV_32FC1: sums
  cv::Mat most_;      // CV_32FC1: greatest weight; unused without choice_, as source_index_
  cv::Mat source_index_;
};

}  // namespace all_in_focus::core
