// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <limits>
#include <map>
#include <opencv2/core.hpp>
#include <vector>

#include "alignment/pair_alignment.hpp"
#include "alignment/similarity_transform.hpp"

namespace all_in_focus::core {

/// Where a frame lies: its motion from the reference frame to it.
struct Placement : SimilarityTransform {
  bool fits = true;      ///< false: it shows something else than the reference; no motion then
  bool measured = true;  ///< false: it could not be aligned and moves like the frame before it
  cv::Vec3d parallax;    ///< roughly: the sum over the pairs between; see CameraMotion
};

/// Aligns the frames of a focus bracket as they come. Memory does not grow but for a thousand numbers per
/// frame.
///
/// Every frame is measured against a key frame, so that errors add up only where the key changes: to the
/// frame before, where the key is too far away.
///
/// A frame that does not fit the key frame, or is too far from it, is measured against the frame before it
/// and all earlier key frames before it counts as another scene. With a lens that breathes, only some of a
/// long bracket are near enough.
class BracketAlignment {
 public:
  /// center: principal point, pixels. relief: of the reference, if known. drifts: the camera is known to
  /// move.
  void begin(const cv::Size& size, const cv::Point2d& center, const Relief& relief = {}, bool drifts = false);

  /// The next frame of the bracket. gray: CV_8UC1, of its size; index: any, each once.
  void observe(const cv::Mat& gray, int index);

  /// Measures an observed frame once more, against the frames of the reference's scene that have come since.
  void reconsider(const cv::Mat& gray, int index, int reference);

  /// Whether the camera itself seems to move: then motions depend on depth.
  bool drifts() const { return drifts_; }

  /// By how many pixels near and far things have moved against each other, at least, as far as the frames of
  /// the reference's scene tell without depth; 0: they tell of no camera that moves. See hiddenParallax().
  /// counts: of the index of a frame, whether it does.
  double hiddenParallax(int reference, const std::function<bool(int)>& counts) const;

  /// Motion of a frame against the reference, both CV_8UC1: this may show that the camera turns, or by depth
  /// that it drifts. None if it is not noticeable. The placement if it cannot be measured, or if the camera
  /// seems neither to turn nor to drift. An empty reference is that of the call before.
  CameraMotion measureMotion(const cv::Mat& reference, const cv::Mat& gray, const Placement& placement);

  /// Placement of one observed frame relative to another, from all that has been observed so far. A motion
  /// that is not significant or not noticeable is none at all.
  Placement placement(int index, int reference) const;

  /// Whether any frame observed so far has moved from the reference. Frames that show something else do not
  /// count.
  bool moves(int reference) const;

 private:
  struct Observation {
    int index = 0;
    int scene = 0;               ///< the same for frames that fit each other
    SimilarityTransform motion;  ///< from the first frame of the scene
    cv::Vec3d parallax;          ///< from there, too: the sum over the pairs
    cv::Matx44d key_covariance;  ///< of the key frame's motion, px^2, as in PairMeasurement
    cv::Matx44d covariance;      ///< of the motion from there
    double tiles = std::numeric_limits<double>::infinity();  ///< that tell it, see PairMeasurement
    bool measured = true;
  };
  struct View {
    ImagePyramid pyramid;
    Observation frame;
  };

  PairMeasurement measureFrom(const View& view);
  PairMeasurement measureFromKey();
  bool placeByOthers(bool measured);
  std::vector<const View*> views(const std::function<bool(const Observation&)>& wanted) const;
  bool placeByOneOf(const std::vector<const View*>& views, bool measured);
  void makeKey(const View& view);
  void keep(const View& view);
  void noteParallax(const PairMeasurement& found);
  void noteTurn(const PairMeasurement& found);
  bool parallaxFollows(const PairMeasurement& found);
  bool isNoticeable(const CameraMotion& motion) const;
  void place(const PairMeasurement& measurement);

  cv::Size size_;
  cv::Point2d center_;
  Relief relief_;
  bool drifts_ = false;
  /// Sums over the frames measured against the reference, over the variance: foretold parallax times that
  /// which was seen, and squared. The same of shift and turn.
  double seen_ = 0, foretold_ = 0, turned_ = 0, shifted_ = 0;
  double radius_ = 0;  ///< half the diagonal, px
  std::map<int, Observation> observations_;
  std::map<int, CellShifts> shifts_;  ///< of the frames that were measured; only where no relief is known
  int scenes_ = 0;

  CameraMotion last_drift_;  ///< that measureMotion() found
  Observation key_;
  PairAlignment key_alignment_, other_alignment_, drift_alignment_;
  View current_, last_;
  std::vector<View> kept_;  ///< the latest key frames, and first frames of scenes that fitted none
};

}  // namespace all_in_focus::core
