// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The whole method on tiny brackets, in all modes, with whatever is known about depth.

#include <nlohmann/json.hpp>

#include "all_in_focus/drawing.hpp"
#include "frames_in_memory.hpp"
#include "images.hpp"
#include "report_json.hpp"
#include "rigs.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

constexpr int kMostFrames = 6;

// What is known about depth.
enum Known { kNothing, kDepth, kRegisteredDepth, kLabels, kKnown };

void readKnown(Input& input, const cv::Size& size, PipelineInput& bracket) {
  const int known = input.below(kKnown);
  const cv::Size other = input.flag() ? size : sizeFrom(input);
  bracket.has_rig = known == kDepth || input.flag();
  if (bracket.has_rig) {
    bracket.rig.depth = cameraFrom(input, other);
    bracket.rig.color = cameraFrom(input, size);
    bracket.rig.depth_to_color = poseFrom(input);
  }
  if (known == kNothing) return;
  const cv::Mat depth = depthFrom(input, other);
  if (known == kDepth) bracket.depth = depth;
  if (known == kRegisteredDepth) bracket.registered_depth = depth;
  if (known == kLabels) depth.convertTo(bracket.labels, CV_32S);
}

void requireResult(const PipelineResult& result, const cv::Mat& frame, int frames) {
  const BracketResult& bracket = result.bracket;
  require(static_cast<int>(bracket.frames.size()) == frames, "another number of frames");
  require(bracket.reference >= 0 && bracket.reference < frames, "a reference that is none of the frames");
  require(bracket.image.size() == frame.size() && bracket.image.type() == CV_8UC3, "no image");
  if (!bracket.source_index.empty()) {
    require(bracket.source_index.size() == frame.size(), "a source index of another size");
    for (const std::uint16_t index : cv::Mat1w(bracket.source_index))
      require(index < frames || index == kNoFrame, "a source that is none of the frames");
    cv::Mat weights;
    drawWeights(bracket.source_index, bracket.confidence, bracket.length, weights);
  }
  for (const std::string& note : bracket.notes)
    require(note.find('\n') == std::string::npos, "not one line: " + note);
  const auto report = nlohmann::json::parse(fusionReport(result, {}));
  require(report["frames_seen"] == frames, "another report");
}

void fuse(Input& input) {
  const Mode mode = static_cast<Mode>(input.below(3));
  const cv::Size size = sizeFrom(input);
  PipelineInput bracket;
  std::vector<cv::Mat> frames;
  for (int i = input.below(kMostFrames); i > 0; --i) {
    const bool fits = input.below(16) != 0;
    frames.push_back(pictureFrom(input, fits ? size : sizeFrom(input)));
    bracket.focus_mm.push_back(input.number());
  }
  if (input.flag()) bracket.focus_mm.clear();
  bracket.reference = input.take<std::int8_t>();
  bracket.optics = {input.number(), input.number(), input.number()};
  bracket.span = input.flag() ? DofSpan::kFull : DofSpan::kPaper;
  RefinedConfig& refined = bracket.refined;
  for (bool* part : {&refined.alignment, &refined.exposure, &refined.prediction, &refined.scales,
                     &refined.brightness, &refined.noise, &refined.soft, &refined.choice})
    *part = input.flag();
  readKnown(input, size, bracket);

  FramesInMemory source(frames);
  bracket.frames = &source;
  Pipeline pipeline(mode);
  const PipelineResult result = pipeline.run(bracket);
  requireResult(result, frames[result.bracket.reference], static_cast<int>(frames.size()));
  source.rewind();
  const PipelineResult again = pipeline.run(bracket);
  require(isSame(result.bracket.image, again.bracket.image), "another image in the second run");
}

void run(Input& input) {
  accepts([&] { fuse(input); });
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  const cv::Size size(48, 40);
  for (int mode = 0; mode < 3; ++mode) {
    for (int known = 0; known < kKnown; ++known) {
      Seed seed;
      putSize(seed.below(mode), size).below(3);
      for (const int i : {0, 1, 2}) putPicture(seed.below(1), 20 * i, 200, 7).number(700 + 500 * i);
      seed.flag(false).below(known % 2 ? 1 : 255).number(24).number(4).number(0.019).flag(true);
      for (int part = 0; part < 10; ++part) seed.flag(true);
      seed.below(known).flag(true);
      if (known != kDepth) seed.flag(true);
      writePose(putCamera(putCamera(seed, 45, size), 50, size), 0, {0.02, 0, 0});
      putBoxes(seed, 1700, {{{10, 10, 20, 20}, 800}, {{5, 12, 5, 12}, 0}});
      seeds.push_back(seed);
    }
  }
  return seeds;
}

const FuzzTarget target("pipeline", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
