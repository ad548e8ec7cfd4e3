// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// How reliable a row of a frame is, pixel by pixel.
struct EvidenceRow {
  const float* sharpness = nullptr;  ///< over all scales (SharpnessPyramid), > 0; never null
  const float* squared_error =
      nullptr;                  ///< that depth and optics predict, gray levels squared; null: nothing
  const float* part = nullptr;  ///< 0..1 of the frame that counts (fadeAlong()); null: all of it
};

/// How a frame fades where it ends within the picture, so that no seam is seen there: in proportion to the
/// distance from its end, over half as many pixels as it lacks. What is sharp there is lost, so it does not
/// fade over more. seen: what the frame shows of one side of the picture, of that size. Returns the parts
/// 0..1 of the frame that count along that side; those along both are multiplied.
std::vector<float> fadeAlong(const cv::Range& seen, int size);

/// Running weighted mean of frames, pixel by pixel, and which of them weighed most. Keeps a few numbers
/// per pixel, however many frames there are.
///
/// A frame weighs
///   sharpness^8 / (predicted squared error + 1/12 + 5 noise variances):
/// the inverse of the variance that is expected of it (1/12 is that of rounding), times a softmax, the power,
/// of what is seen. As such powers overflow, weights are kept in units of the greatest sharpness so far. Each
/// frame moves the mean by its share of all weights, so that no sum of colours is needed. Where only a part
/// of a frame counts, it moves the mean by that part of its share: a small weight would not do, because
/// weights of a sharp frame are many times those of others. The mean is rounded to codes of 16 bits: two
/// bytes instead of the four of a float.
///
/// A frame of 640x480 takes 0.5 ms; the same as a sequence of OpenCV's operations, 32 rows at a time, 6.5 ms
/// (one thread).
class WeightedMean {
 public:
  struct Kind {
    bool soft = true;    ///< false: the frame that weighs most is copied, for comparison
    bool choice = true;  ///< false: no sourceIndex() and confidence(), whose sums are 6 of 20 bytes a pixel
    bool steep = false;  ///< the power grows where there is little noise, up to 12
    /// Some frames are resampled: small differences of sharpness count less. `steep` is not used then.
    bool resampled = false;
  };

  /// noise: standard deviation of the frames' noise in gray levels, >= 0.
  void begin(const cv::Size& size, double noise, const Kind& kind);

  /// The rows that follow are of this frame. lut: the code of 16 bits that each of its codes stands for
  /// (gainLut()); empty: as it is.
  void beginFrame(int index, std::vector<std::uint16_t> lut);

  /// Adds row y of the frame, CV_8UC3 or CV_16UC3. columns: those that it has seen. Other threads may add
  /// other rows at the same time.
  void addRow(int y, const cv::Range& columns, const cv::Mat& frame, const EvidenceRow& evidence);

  cv::Mat image(int depth) const;                               ///< CV_8UC3 or CV_16UC3
  const cv::Mat& sourceIndex() const { return source_index_; }  ///< CV_16UC1
  cv::Mat confidence() const;  ///< CV_8UC1: 255 (1 - mean weight / largest), scaled so that 255 = no rival

 private:
  bool soft_ = true, choice_ = true;
  int frames_ = 0;
  float steep_ = 0;  // 0: power 8; 1: power 12; less than 0: flatter where frames are about as sharp
  float error_floor_ = 1;
  std::uint16_t index_ = 0;         // of the frame being added
  std::vector<std::uint16_t> lut_;  // of that frame
  cv::Mat mean_;                    // CV_16UC3, codes of 16 bits (hard: of the heaviest frame)
  cv::Mat sharpest_;                // CV_32FC1: greatest sharpness; a weight of 1 is its 8th power
  cv::Mat weights_;                 // CV_32FC1: sums
  cv::Mat most_;                    // CV_32FC1: greatest weight; unused without choice_, as source_index_
  cv::Mat source_index_;
};

}  // namespace all_in_focus::core
