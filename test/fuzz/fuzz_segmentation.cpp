// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Segmentation of tiny depth images, compared with its plain definition, and what is made of its regions for
// people.

#include <nlohmann/json.hpp>
#include <tuple>

#include "all_in_focus/drawing.hpp"
#include "images.hpp"
#include "report_json.hpp"
#include "target.hpp"
#include "unit/reference_segmentation.hpp"

namespace all_in_focus::fuzz {
namespace {

void requireSame(const Segmentation& result, const Segmentation& expected) {
  require(isSame(result.labels, expected.labels), "labels not as defined");
  require(result.unknown_area == expected.unknown_area, "another unknown area");
  require(result.segments.size() == expected.segments.size(), "another number of segments");
  const auto tie = [](const core::Segment& s) {
    return std::tie(s.label, s.area, s.min_mm, s.max_mm, s.median_mm, s.fits);
  };
  for (std::size_t i = 0; i < expected.segments.size(); ++i)
    require(tie(result.segments[i]) == tie(expected.segments[i]), "another segment");
}

void requirePlan(const Segmentation& segmentation, const core::Optics& optics) {
  std::vector<PlannedFocus> plan;
  if (!accepts([&] { plan = planFocus(optics, segmentation.segments); })) return;
  constexpr double kRounding = 1e-6;
  for (const core::Segment& segment : segmentation.segments) {
    for (const int mm : {segment.min_mm, segment.max_mm}) {
      const bool is_sharp = std::any_of(plan.begin(), plan.end(), [mm](const PlannedFocus& one) {
        return one.near_mm <= mm * (1 + kRounding) && one.far_mm >= mm * (1 - kRounding);
      });
      require(is_sharp, "a depth that is sharp in no exposure of the plan");
    }
  }
  const auto report = nlohmann::json::parse(segmentationReport(segmentation, optics, "paper"));
  require(report["segment_table"].size() == segmentation.segments.size(), "a report without all segments");
}

void run(Input& input) {
  const ThreadsFrom threads(input);
  SegmentationConfig config;
  config.optics = {input.number(), input.number(), input.number()};
  config.span = input.flag() ? DofSpan::kFull : DofSpan::kPaper;
  config.min_region_size = input.take<std::int16_t>();
  config.merge_against_rule = input.flag();
  std::unique_ptr<DofSegmentation> segmentation;
  if (!accepts([&] { segmentation = std::make_unique<DofSegmentation>(config); })) return;
  Segmentation result;
  for (int i = 0; i < 3; ++i) {  // what was learnt from one image speeds up the next, and changes no label
    const cv::Mat depth = depthFrom(input, sizeFrom(input));
    if (!accepts([&] { segmentation->compute(depth, result); })) continue;
    requireSame(result, core::referenceSegmentation(depth, config));
    requirePlan(result, config.optics);
    cv::Mat picture;
    drawRegions(result, captionRegions(result), picture);
    require(picture.type() == CV_8UC3 && picture.rows > depth.rows, "no picture of the regions");
  }
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  for (const auto& optics :
       {std::array<double, 3>{24, 4, 0.019}, {50, 1.8, 0.03}, {0.1, 1000, 10}, {200, 1, 1e-6}}) {
    for (const bool against_rule : {false, true}) {
      Seed seed;
      seed.below(against_rule ? 7 : 0);
      for (const double number : optics) seed.number(number);
      seed.flag(against_rule).put<std::int16_t>(10).flag(against_rule);
      putBoxes(putSize(seed, {40, 24}), 2800,
               {{{5, 5, 20, 20}, 900}, {{2, 8, 3, 7}, 0}, {{30, 0, 1, 40}, 1000}});
      putNoise(putSize(seed, {16, 64}), 900, 300);
      putNoise(putSize(seed, {16, 64}), 900, 300, 2);
      seeds.push_back(seed);
    }
  }
  return seeds;
}

const FuzzTarget target("segmentation", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
