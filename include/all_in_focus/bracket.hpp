// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "all_in_focus/fusion.hpp"

namespace all_in_focus::core {

class BracketFusion;
class BracketRestoration;

/// One line of a text for people: those of libraries' exceptions may have several, and end with a line break.
std::string oneLine(std::string text);

/// How one bracket is fused.
struct BracketSettings {
  Mode mode = Mode::kRefined;
  RefinedConfig refined;
  int length = 0;                  ///< frames that the bracket will have, 0 = unknown
  int reference = kAutoReference;  ///< index of the frame whose geometry and exposure mode refined keeps
  int max_held = kNoFrame;         ///< how many frames may be held back, or fused anew, at a time
  bool sliding = false;            ///< preview() is wanted after every frame: none is held back or restored
  /// A scene or a frame that cannot be used throws std::invalid_argument. Otherwise a warning tells of it and
  /// the bracket goes on without it.
  bool strict = false;
  /// What messages call a frame; none: "frame 7".
  std::function<std::string(int index)> frame_name;

  /// Receives each frame when it is fused, in the geometry of the reference, which comes first. A bracket
  /// that starts over gives frames again. Mode paper aligns none.
  std::function<void(const AlignedFrame&)> on_aligned;

  /// The middle one of `length`, else the first; but one of the largest group of frames that were taken
  /// alike.
  static constexpr int kAutoReference = -1;
};

/// What has become of a frame.
struct FrameStatus {
  enum class Kind {
    kHeld,  ///< Bracket will ask for it again
    kUsed,
    kRejected,
  };
  int index = 0;
  Kind kind = Kind::kHeld;
  std::string reason;  ///< kRejected: why; else ""
};

/// The result of one bracket. `image` is empty when no frame could be used.
struct BracketResult : FusionResult {
  Mode mode = Mode::kRefined;   ///< that ran: where restoration is not possible, restored becomes refined
  bool sharpness_alone = true;  ///< neither labels nor depth nor a restoration counts
  bool has_labels = false;      ///< labels were used
  cv::Mat restored_depth;       ///< CV_16UC1 mm, from the bracket; empty unless restored
  double blur_scale = 0;  ///< measured blur / blur that the optics predict; 0 = unknown, or not restored
  bool stopped = false;   ///< progress stopped the restoration: the image is refined
  int reference = 0;      ///< frame whose geometry and exposure the image has; mode paper: the nearest to it
  int length = 0;         ///< frames of the bracket, as far as known
  std::vector<FrameStatus> frames;    ///< all that came, by index
  int used = 0, rejected = 0;         ///< how many of them
  std::vector<std::string> warnings;  ///< for the user: what is refused, and its effect, one line each
  double fusion_ms = 0;               ///< all frames, without reading them
  double restoration_ms = 0;
};

/// One focus bracket, from its first frame to the result: the whole life of the method after depth and
/// segmentation. Files and nodes both use it, so both give the same pixels.
///
///   begin(scene, settings, again); add(frame 0); add(frame 1); ... ; finish()
///
/// Mode paper fuses frames as they come. Modes refined and restored fuse the reference first, then the frames
/// before it, then those behind it, because the result has its geometry and exposure. Frames that come before
/// the reference are held back: their pixels are not kept, but asked for again. If depth is known, and frames
/// show late that the camera moves, the bracket starts over: it asks for all that were fused, max_held at
/// most.
///
/// All frames of a bracket must have one size, show the same and have a similar exposure. Frames that do not
/// fit are held back, too: if most turn out to be like them, the bracket starts over; and at its end what
/// they show is compared with that of later frames. An automatic reference that was taken unlike most frames
/// gives its place to another one.
///
/// Memory does not grow with the number of frames. Not thread-safe; the largest buffers are reused from
/// bracket to bracket.
class Bracket {
 public:
  /// Returns once more a frame that Bracket holds.
  using FrameAgain = std::function<cv::Mat(int index)>;
  /// Receives how much of the restoration is done, 0..1; returns false to stop it.
  using Progress = std::function<bool(double done)>;

  Bracket();
  ~Bracket();
  Bracket(const Bracket&) = delete;
  Bracket& operator=(const Bracket&) = delete;

  /// Starts a bracket. The scene's images are shared, not copied.
  void begin(const BracketScene& scene, const BracketSettings& settings, FrameAgain again);

  /// Takes the next frame and fuses all frames that can be fused now. frame: CV_8UC3, or CV_16UC3 for a
  /// result of 16 bits; with a fourth channel pixels whose alpha is 0 weigh nothing. index: 0..65534, its
  /// place in the bracket, greater than that of the frame before. focus_mm: NaN = unknown, may be infinite.
  FrameStatus add(const cv::Mat& frame, int index, double focus_mm = kUnknownFocus);

  /// Takes note of a frame that came but cannot be read.
  FrameStatus reject(int index, const std::string& reason);

  /// Adds labels that have come late. The result lists their regions; no pixel depends on them. Not for mode
  /// paper.
  void setLabels(const cv::Mat& labels);

  /// Whether the frame may be asked for again; false once finish() has fused the last frame.
  bool holds(int index) const { return held_.count(index) + fused_.count(index) > 0; }

  /// The result of the frames fused so far.
  BracketResult preview() const;

  /// The result; no frame follows. Fuses the frames that are held back, also if the reference never came:
  /// then the nearest frame takes its place. Mode restored: restores, unless `progress` says stop.
  BracketResult finish(const Progress& progress = {});

 private:
  struct Held {
    cv::Size size;
    double focus_mm;
    std::string misfit;  ///< why it waits for the end of the bracket; "" = it does not
  };

  void planReference(int first_index);
  void chooseReference(bool may_wait);
  void take(const cv::Mat& frame, int index, double focus_mm);
  void start(const cv::Size& wanted, bool drifts = false);
  void drop(const std::function<std::string(int index)>& why);
  bool passes(const std::function<void()>& check, const std::string& effect);
  cv::Mat usableLabels(const cv::Size& size);
  BracketScene usableScene(const cv::Size& size);
  double usableFocus(int index, double focus_mm);
  std::optional<int> next() const;
  cv::Mat frameAt(int index) const;
  void observe(int index);
  void fuseReady();
  bool fuse(int index);
  bool mayWait() const;
  bool startsOver(int newest);
  bool startsOverMoved();
  void markUsed(int index);
  void markRejected(int index, const std::string& reason);
  FrameStatus& statusOf(int index);
  void limitHeld();
  std::string name(int index) const;
  std::string anotherSize(const cv::Size& size) const;
  std::string whyNotHeld() const;
  std::string whyUnused(const Held& held) const;
  void restore(bool has_moved, const Progress& progress, BracketResult& result) const;
  bool isFree() const { return settings_.reference == BracketSettings::kAutoReference; }
  int mostHeld() const { return settings_.sliding ? 0 : settings_.max_held; }
  bool restores() const { return settings_.mode == Mode::kRestored && !settings_.sliding; }

  BracketScene scene_;
  BracketSettings settings_;
  FrameAgain again_;
  std::unique_ptr<BracketFusion> fusion_;
  std::unique_ptr<BracketRestoration> restoration_;

  cv::Size size_;                               // of the frames that are fused; empty before the first
  std::map<std::pair<int, int>, int> of_size_;  // frames seen of each width and height
  int reference_ = 0;                           // wanted
  int nearest_ = 0;                             // the used frame that stands for it
  bool holding_ = false;                        // all frames wait for the reference
  bool is_ending_ = false;                      // no frame follows
  std::map<int, Held> held_;                    // by index
  std::map<int, Held> fused_;        // all that were, by index, while they may be fused anew; else empty
  bool drifts_ = false;              // known when the first frame was fused
  int still_ = 0;                    // frames behind the first that were fused while no motion was known
  std::vector<FrameStatus> frames_;  // by index
  std::pair<int, cv::Mat> current_;  // the frame that is being added
  int used_ = 0;
  bool has_labels_ = false, predicts_ = false, focus_known_ = false, focus_refused_ = false;
  std::vector<std::string> scene_warnings_, notes_;
  double fusion_ms_ = 0;
};

}  // namespace all_in_focus::core
