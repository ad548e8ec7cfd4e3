// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/bracket.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <utility>

#include "fusion/bracket_fusion.hpp"
#include "restoration/restoration.hpp"
#include "util/stopwatch.hpp"

namespace all_in_focus::core {
namespace {

constexpr std::size_t kMostRejections = 20;  // that notes tell of one by one
const std::string kNoFocus = "no focus distances: depth and lens data are not used";
const std::string kFocusFound =
    "no focus distances: restored by those at which surfaces of known depth are sharpest, in even steps";
constexpr const char* kNotUsed = ": depth and lens data are not used";
constexpr double kMmPerM = 1000;
constexpr int kNone = -1;  // no frame has this index

std::string text(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

// Throws unless the sides have the proportion of the frames' sides, to 1 %.
void requireShape(const cv::Size& size, const char* what, const cv::Size& frame) {
  const double stretch =
      static_cast<double>(size.width) * frame.height / (static_cast<double>(size.height) * frame.width);
  if (std::abs(stretch - 1) <= 0.01) return;
  throw std::invalid_argument(std::string(what) + " of " + text(size) + " for frames of " + text(frame) +
                              ": not the same picture");
}

void checkLabels(const cv::Mat& labels, const cv::Size& frame) {
  if (labels.empty()) return;
  if (labels.type() != CV_32SC1) throw std::invalid_argument("label image refused: it must be CV_32SC1");
  double smallest = 0;
  cv::minMaxLoc(labels, &smallest);
  if (smallest < 0)
    throw std::invalid_argument(cv::format("label image refused: negative label %g", smallest));
  requireShape(labels.size(), "label image refused: one", frame);
}

void checkDepth(const cv::Mat& depth, const cv::Size& frame) {
  if (depth.empty()) return;
  if (depth.type() != CV_16UC1) throw std::invalid_argument("depth refused: it must be CV_16UC1");
  requireShape(depth.size(), "depth refused: an image", frame);
}

void checkMeasured(const cv::Mat& measured, const cv::Mat& depth) {
  if (measured.empty() || (measured.type() == CV_16UC1 && measured.size() == depth.size())) return;
  throw std::invalid_argument("depth before its holes were filled is " + text(measured.size()) +
                              ", filled depth is " + text(depth.size()));
}

bool isColor(const cv::Mat& frame) {
  return (frame.depth() == CV_8U || frame.depth() == CV_16U) &&
         (frame.channels() == 3 || frame.channels() == 4) && !frame.empty();
}

void checkCamera(const BracketScene& scene, const cv::Size& frame) {
  validate(scene.optics);
  if (!scene.camera) return;
  validate(*scene.camera, "colour camera");
  requireShape(scene.camera->size, "calibration of the colour camera refused: it is one", frame);
}

}  // namespace

std::string oneLine(std::string text) {
  text.erase(text.find_last_not_of(" \n") + 1);
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

Bracket::Bracket()
    : fusion_(std::make_unique<BracketFusion>()), restoration_(std::make_unique<BracketRestoration>()) {}
Bracket::~Bracket() = default;

void Bracket::begin(const BracketScene& scene, const BracketSettings& settings, FrameAgain again) {
  scene_ = scene;
  settings_ = settings;
  again_ = std::move(again);
  size_ = {};
  of_size_.clear();
  reference_ = nearest_ = 0;
  holding_ = is_ending_ = false;
  held_.clear();
  fused_.clear();
  frames_.clear();
  used_ = 0;
  has_labels_ = predicts_ = focus_known_ = focus_refused_ = false;
  scene_warnings_.clear();
  notes_.clear();
  if (settings.mode == Mode::kRestored && settings.sliding)
    notes_.emplace_back("not restored: sliding results are refined");
  fusion_ms_ = 0;
}

// Frames before the reference are held. Adds a note if it will not be the wanted one.
void Bracket::planReference(int first_index) {
  const int length = settings_.length;
  reference_ = settings_.reference >= 0 ? settings_.reference : length / 2;
  if (length > 0) reference_ = std::min(reference_, length - 1);
  if (settings_.mode == Mode::kPaper || reference_ <= first_index) return;
  holding_ = reference_ - first_index <= mostHeld();
  if (holding_) return;
  notes_.push_back(whyNotHeld() + ": the first frame is the reference, not " + name(reference_));
  reference_ = first_index;
}

// Ends the holding when the reference has come. An automatic one shall be in the middle of the largest group
// of frames that were taken alike. Where the frames seen do not tell which group that is, more are held.
void Bracket::chooseReference(bool may_wait) {
  const int last = frames_.empty() ? -1 : frames_.back().index;
  if (!holding_ || (may_wait && last < reference_)) return;
  const bool is_full = !may_wait || held_.size() >= static_cast<std::size_t>(settings_.max_held);
  if (isFree() && !size_.empty()) {
    const FrameGroup group = fusion_->largestGroup();
    if (!is_full && group.lead < settings_.length - 1 - last) return;
    std::vector<int> alike;  // or still unknown
    for (int i = 0; i < std::max(settings_.length, last + 1); ++i) {
      if (group.others.count(i) == 0) alike.push_back(i);
    }
    // Two are in the middle of an even number: the one that is nearer to the middle of the bracket.
    const int before = alike[(alike.size() - 1) / 2], behind = alike[alike.size() / 2];
    const int middle = settings_.length / 2;
    reference_ = std::abs(before - middle) < std::abs(behind - middle) ? before : behind;
    if (!is_full && reference_ > last) return;
    if (may_wait && reference_ > last)
      reference_ = *std::prev(std::upper_bound(alike.begin(), alike.end(), last));
    for (auto& [index, held] : held_) {
      if (group.others.count(index) > 0) held.misfit = "it was taken unlike most frames";
    }
  }
  holding_ = false;
}

FrameStatus Bracket::add(const cv::Mat& frame, int index, double focus_mm) {
  if (frames_.empty()) planReference(index);
  if (!frames_.empty() && index <= frames_.back().index)
    throw std::logic_error("bracket: frames must come in the order of their index");
  frames_.push_back({index, FrameStatus::Kind::kHeld, ""});
  try {
    take(frame, index, usableFocus(index, focus_mm));
  } catch (const std::exception& e) {
    if (settings_.strict) throw;
    markRejected(index, oneLine(e.what()));
    fuseReady();
  }
  current_ = {};
  return frames_.back();
}

FrameStatus Bracket::reject(int index, const std::string& reason) {
  if (frames_.empty()) planReference(index);
  frames_.push_back({index, FrameStatus::Kind::kRejected, oneLine(reason)});
  fuseReady();
  return frames_.back();
}

void Bracket::setLabels(const cv::Mat& labels) {
  scene_.labels = labels;
  if (size_.empty()) return;  // start() takes them
  const cv::Mat usable = usableLabels(size_);
  fusion_->setLabels(usable);
  has_labels_ = !usable.empty();
}

void Bracket::take(const cv::Mat& frame, int index, double focus_mm) {
  if (!isColor(frame))
    throw std::invalid_argument(name(index) +
                                " must have 8 or 16 bits, three or four channels and not be empty");
  if (index < 0 || index >= kNoFrame)
    throw std::invalid_argument(cv::format("frame index %d is not in 0..65534", index));
  const cv::Size size = frame.size();
  if (settings_.strict && !size_.empty() && size != size_) {
    throw std::invalid_argument(name(index) + " is " + text(size) + ", but the bracket began with " +
                                text(size_));
  }
  current_ = {index, frame};
  held_[index] = {size, focus_mm, ""};
  const int like_this = ++of_size_[{size.width, size.height}];
  if (size_.empty() || like_this > of_size_[{size_.width, size_.height}]) {
    start(size);
  } else if (holding_ && size == size_) {
    observe(index);
  }
  fuseReady();
  limitHeld();
}

// Gives the fused frames up.
void Bracket::drop(const std::function<std::string(int index)>& why) {
  for (const FrameStatus& frame : std::vector<FrameStatus>(frames_)) {
    if (frame.kind == FrameStatus::Kind::kUsed) markRejected(frame.index, why(frame.index));
  }
  used_ = 0;
  fused_.clear();
}

// Starts to fuse frames of a size, or starts over with them. Those that did not fit are judged anew.
void Bracket::start(const cv::Size& wanted, bool drifts) {
  const cv::Size size = wanted;  // which may be size_ itself
  for (auto& [index, held] : held_) held.misfit.clear();
  const cv::Size before = std::exchange(size_, size);
  if (before != size) drop([&](int) { return anotherSize(before); });
  size_ = {};  // until all has begun: where memory is short, the next frame begins anew
  scene_warnings_.clear();
  const BracketScene scene = usableScene(size);
  fusion_->begin(scene, size, settings_.mode, settings_.refined, drifts);
  if (restores()) restoration_->begin(scene);
  fusion_->setAlignedFrameCallback([this](const AlignedFrame& frame) {
    if (restores()) restoration_->add(frame);
    if (settings_.on_aligned) settings_.on_aligned(frame);
  });
  size_ = size;
  has_labels_ = !scene.labels.empty();
  predicts_ = !scene.depth.empty() && scene.camera;

  const std::optional<int> first = next();
  for (const auto& [index, held] : held_) {
    if (held.size == size_ && (!first || index < *first)) observe(index);
  }
}

// Whether a check of the scene passes. If not, a warning tells of it.
bool Bracket::passes(const std::function<void()>& check, const std::string& effect) {
  try {
    check();
    return true;
  } catch (const std::exception& e) {
    if (settings_.strict) throw;
    scene_warnings_.push_back(oneLine(e.what()) + effect);
    return false;
  }
}

cv::Mat Bracket::usableLabels(const cv::Size& size) {
  const char* effect =
      settings_.mode == Mode::kPaper ? ": fused by sharpness alone" : ": the report lists no regions";
  return passes([&] { checkLabels(scene_.labels, size); }, effect) ? scene_.labels : cv::Mat();
}

// Leaves out what does not fit frames of that size.
BracketScene Bracket::usableScene(const cv::Size& size) {
  BracketScene usable = scene_;
  // First, because depth and labels that were registered by a wrong calibration do not fit either.
  if (!passes([&] { checkCamera(usable, size); }, kNotUsed)) {
    usable.camera.reset();
    usable.optics = {};
  }
  usable.labels = usableLabels(size);
  if (settings_.mode == Mode::kPaper) usable.depth = usable.measured = cv::Mat();
  if (!passes([&] { checkDepth(usable.depth, size); }, kNotUsed)) usable.depth = usable.measured = cv::Mat();
  if (!passes([&] { checkMeasured(usable.measured, usable.depth); }, ": filled depth counts as measured"))
    usable.measured = cv::Mat();
  return usable;
}

double Bracket::usableFocus(int index, double focus_mm) {
  const double focal_length_mm = scene_.camera ? scene_.optics.focal_length_mm : 0;
  if (std::isnan(focus_mm) || focus_mm > focal_length_mm) {
    focus_known_ = focus_known_ || !std::isnan(focus_mm);
    return focus_mm;
  }
  const std::string refusal = name(index) + cv::format(": a lens of %g mm cannot be focused at %g m",
                                                       focal_length_mm, focus_mm / kMmPerM);
  if (settings_.mode == Mode::kPaper) return kUnknownFocus;
  if (settings_.strict) throw std::invalid_argument(refusal);
  if (!std::exchange(focus_refused_, true)) notes_.push_back(refusal + ": such focus distances are unknown");
  return kUnknownFocus;
}

// At most mostHeld() frames are held that do not fit, and no more together with those that were fused.
void Bracket::limitHeld() {
  std::vector<int> others;
  for (const auto& [index, held] : held_) {
    if (held.size != size_ || !held.misfit.empty()) others.push_back(index);
  }
  for (std::size_t i = 0; i + static_cast<std::size_t>(mostHeld()) < others.size(); ++i)
    markRejected(others[i], whyUnused(held_.at(others[i])));
  if (held_.size() + fused_.size() > static_cast<std::size_t>(mostHeld())) fused_.clear();
}

std::string Bracket::whyNotHeld() const {
  if (settings_.sliding) return "sliding";
  return cv::format("at most %d frames are held (max_held_frames, memory)", settings_.max_held);
}

std::string Bracket::whyUnused(const Held& held) const {
  return held.misfit.empty() ? anotherSize(held.size) : held.misfit;
}

std::string Bracket::name(int index) const {
  return settings_.frame_name ? settings_.frame_name(index) : "frame " + std::to_string(index);
}

// The frame that is fused next, if any. Of two that are as near to the reference it is the first one.
std::optional<int> Bracket::next() const {
  if (holding_) return std::nullopt;
  std::optional<int> found;
  for (const auto& [index, held] : held_) {
    if (held.size != size_ || !held.misfit.empty()) continue;
    if (settings_.mode == Mode::kPaper || used_ > 0) return index;
    if (!found || std::abs(index - reference_) < std::abs(*found - reference_)) found = index;
  }
  return found;
}

cv::Mat Bracket::frameAt(int index) const {
  if (index == current_.first && !current_.second.empty()) return current_.second;
  cv::Mat frame = again_(index);
  if (!isColor(frame) || frame.size() != size_)
    throw std::invalid_argument(name(index) + " was another picture when it was read again");
  return frame;
}

void Bracket::observe(int index) {
  const cv::Mat frame = frameAt(index);
  Stopwatch watch;
  fusion_->observe(frame, index, held_.at(index).focus_mm);
  fusion_ms_ += watch.lap();
}

void Bracket::fuseReady() {
  chooseReference(/*may_wait=*/true);
  int misfit = kNone;  // the newest one
  do {
    misfit = kNone;
    while (const std::optional<int> index = next()) {
      if (!fuse(*index)) misfit = *index;
    }
  } while ((misfit != kNone && startsOver(misfit)) || startsOverMoved());
}

// Returns false if the frame does not fit those fused so far. It is kept: they may be the odd ones.
bool Bracket::fuse(int index) {
  try {
    const cv::Mat frame = frameAt(index);
    Held& held = held_.at(index);
    Stopwatch watch;
    held.misfit = fusion_->add(frame, index, held.focus_mm, mayWait());
    fusion_ms_ += watch.lap();
    if (!held.misfit.empty()) return false;
    markUsed(index);
  } catch (const std::exception& e) {
    if (settings_.strict) throw;
    markRejected(index, oneLine(e.what()));
  }
  return true;
}

// Whether a frame may be held until the end of the bracket.
bool Bracket::mayWait() const {
  const auto waits = [](const auto& held) { return !held.second.misfit.empty(); };
  return !is_ending_ && std::count_if(held_.begin(), held_.end(), waits) < mostHeld();
}

// Starts over with the frames that are like the newest one that does not fit, if these are more than those
// fused. Returns whether it did.
bool Bracket::startsOver(int newest) {
  if (!isFree()) return false;
  std::vector<int> alike;
  for (const auto& [index, held] : held_) {
    if (!held.misfit.empty() && fusion_->misfit(index, newest).empty()) alike.push_back(index);
  }
  if (alike.size() <= static_cast<std::size_t>(used_)) return false;
  drop([&](int used) {
    const std::string misfit = fusion_->misfit(used, newest);
    return misfit.empty() ? "the reference that it was fused with was given up" : misfit;
  });
  reference_ = alike.front();
  start(size_);
  return true;
}

// Starts over with the frames fused so far if the first of them were fused before it showed that the camera
// moves: then depth moves them, too. Returns whether it did.
bool Bracket::startsOverMoved() {
  if (drifts_ || !fusion_->drifts() || fused_.empty()) return false;
  for (const auto& fused : fused_) statusOf(fused.first).kind = FrameStatus::Kind::kHeld;
  held_.merge(fused_);
  used_ = 0;
  start(size_, /*drifts=*/true);
  return true;
}

// Mode paper keeps no geometry: there the nearest of all frames stands for the reference.
void Bracket::markUsed(int index) {
  const bool is_nearer = std::abs(index - reference_) < std::abs(nearest_ - reference_);
  const bool has_all = fused_.size() == static_cast<std::size_t>(used_);
  if (used_++ == 0 || (settings_.mode == Mode::kPaper && is_nearer)) nearest_ = index;
  if (used_ == 1) {
    drifts_ = fusion_->drifts();
    still_ = 0;
  } else if (!fusion_->drifts()) {
    ++still_;
  }
  auto frame = held_.extract(index);
  if (!drifts_ && fusion_->mayDrift() && has_all) {
    fused_.insert(std::move(frame));
  } else {
    fused_.clear();
  }
  statusOf(index).kind = FrameStatus::Kind::kUsed;
}

void Bracket::markRejected(int index, const std::string& reason) {
  held_.erase(index);
  statusOf(index) = {index, FrameStatus::Kind::kRejected, reason};
}

FrameStatus& Bracket::statusOf(int index) {
  return *std::lower_bound(frames_.begin(), frames_.end(), index,
                           [](const FrameStatus& frame, int wanted) { return frame.index < wanted; });
}

std::string Bracket::anotherSize(const cv::Size& size) const {
  return "the frame is " + text(size) + ", most of the bracket is " + text(size_);
}

BracketResult Bracket::preview() const {
  BracketResult result;
  if (used_ > 0) static_cast<FusionResult&>(result) = fusion_->result();
  result.mode = settings_.mode == Mode::kPaper ? Mode::kPaper : Mode::kRefined;
  if (!size_.empty()) result.sharpness_alone = fusion_->bySharpnessAlone();
  result.has_labels = has_labels_;
  result.reference = nearest_;
  result.length = std::max(settings_.length, frames_.empty() ? 0 : frames_.back().index + 1);
  result.frames = frames_;
  result.used = used_;
  result.warnings = scene_warnings_;
  result.fusion_ms = fusion_ms_;

  std::vector<std::string> notes = notes_;
  if (predicts_ && !focus_known_) notes.push_back(kNoFocus);
  if (used_ > 0 && settings_.mode != Mode::kPaper && nearest_ != reference_) {
    notes.push_back("the reference, " + name(reference_) + ", is missing or was rejected: " + name(nearest_) +
                    " takes its place");
  }
  if (used_ > 0 && still_ > 0 && fusion_->drifts())
    notes.push_back(whyNotHeld() +
                    cv::format(": %d frames that were fused before the camera was found to move are "
                               "not corrected by depth",
                               still_));
  for (const FrameStatus& frame : frames_) {
    if (frame.kind != FrameStatus::Kind::kRejected) continue;
    if (static_cast<std::size_t>(result.rejected++) < kMostRejections)
      notes.push_back(name(frame.index) + " rejected: " + frame.reason);
  }
  result.notes.insert(result.notes.begin(), notes.begin(), notes.end());
  return result;
}

BracketResult Bracket::finish(const Progress& progress) {
  const int last = frames_.empty() ? -1 : frames_.back().index;
  if (settings_.strict && frames_.empty()) throw std::invalid_argument("the bracket holds no frame");
  if (settings_.strict && !isFree() && (settings_.reference < 0 || reference_ > last)) {
    throw std::invalid_argument(
        cv::format("frame %d cannot be the reference: the bracket holds frames 0 to %d",
                   settings_.reference < 0 ? settings_.reference : reference_, last));
  }
  is_ending_ = true;
  chooseReference(/*may_wait=*/false);
  fuseReady();
  for (auto& [index, held] : held_) held.misfit.clear();  // each gets a second chance
  fuseReady();
  while (!held_.empty()) markRejected(held_.begin()->first, whyUnused(held_.begin()->second));
  fused_.clear();
  Stopwatch watch;
  BracketResult result = preview();
  const std::string hidden_drift = fusion_->hiddenDriftNote();
  if (!hidden_drift.empty()) result.notes.push_back(hidden_drift);
  if (restores() && predicts_ && !focus_known_ && restoration_->findFocus())
    std::replace(result.notes.begin(), result.notes.end(), kNoFocus, kFocusFound);
  result.fusion_ms += watch.lap();
  if (restores()) {
    restore(fusion_->drifts() || !hidden_drift.empty(), progress, result);
    // Restoration has asked all frames, not only those before the reference.
    if (result.mode == Mode::kRestored) result.lens_notes.clear();
    result.restoration_ms = watch.lap();
  }
  result.notes.insert(result.notes.end(), result.lens_notes.begin(), result.lens_notes.end());
  return result;
}

// Replaces the picture of mode refined, or says why not.
void Bracket::restore(bool has_moved, const Progress& progress, BracketResult& result) const {
  if (result.image.empty()) return;
  const std::string missing = restoration_->missing();
  if (!missing.empty()) {
    result.notes.push_back("not restored: " + missing);
    return;
  }
  try {
    const std::optional<RestorationResult> restored = restoration_->restore(
        result.image, progress, has_moved ? std::optional(result.reference) : std::nullopt);
    result.stopped = !restored;
    if (!restored) return;
    result.blur_scale = restored->blur_scale;
    result.notes.insert(result.notes.end(), restored->notes.begin(), restored->notes.end());
    if (!restored->refusal.empty()) {
      result.notes.push_back("not restored: " + restored->refusal);
      return;
    }
    result.image = restored->image;
    result.restored_depth = restored->depth;
    result.mode = Mode::kRestored;
    result.sharpness_alone = false;
  } catch (const std::exception& e) {
    if (settings_.strict) throw;
    result.warnings.push_back("not restored: " + oneLine(e.what()));
  }
}

}  // namespace all_in_focus::core
