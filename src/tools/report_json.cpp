// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "report_json.hpp"

#include <nlohmann/json.hpp>

#include "all_in_focus/focus_plan.hpp"

namespace all_in_focus {
namespace {

using Json = nlohmann::json;

constexpr int kReportVersion = 1;

// Notes may name files, and those may be named in any encoding.
std::string text(const Json& report) {
  return report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json opticsJson(const Optics& optics) {
  return {{"focal_length_mm", optics.focal_length_mm},
          {"aperture", optics.aperture},
          {"circle_of_confusion_mm", optics.circle_of_confusion_mm}};
}

Json tableJson(const Segmentation& segmentation, const Optics& optics) {
  Json table = Json::array();
  for (const Segment& s : segmentation.segments) {
    table.push_back({{"label", s.label},
                     {"area", s.area},
                     {"depth_min", s.min_mm / 1000.0},
                     {"depth_max", s.max_mm / 1000.0},
                     {"depth_median", s.median_mm / 1000.0},
                     {"diff", (s.max_mm - s.min_mm) / 1000.0},
                     {"max_dof", maxDof(optics, s.min_mm, s.max_mm) / 1000.0},
                     {"fits", s.fits},
                     {"focus_distance", dioptricMiddle(s.min_mm, s.max_mm) / 1000.0}});
  }
  return table;
}

Json planJson(const Segmentation& segmentation, const Optics& optics) {
  Json plan = Json::array();
  for (const PlannedFocus& one : planFocus(optics, segmentation.segments)) {
    plan.push_back({{"focus_distance", one.focus_mm / 1000},
                    {"near_limit", one.near_mm / 1000},
                    {"far_limit", one.far_mm / 1000}});
  }
  return plan;
}

}  // namespace

std::string fusionReport(const PipelineResult& result, const ReportContext& context) {
  const BracketResult& bracket = result.bracket;
  Json segments = Json::array();
  for (const RegionChoice& choice : bracket.regions) {
    segments.push_back({{"label", choice.label},
                        {"frame", choice.frame},
                        {"score", choice.score},
                        {"margin", choice.margin},
                        {"confidence", choice.confidence}});
  }
  Json timing_names = {"depth", "segmentation", "fusion"};
  Json timing_ms = {result.depth_ms, result.segmentation_ms, bracket.fusion_ms};
  if (bracket.mode == Mode::kRestored) {
    timing_names.push_back("restoration");
    timing_ms.push_back(bracket.restoration_ms);
  }
  const Json report = {{"version", kReportVersion},
                       {"bracket_id", 0},
                       {"mode", name(bracket.mode)},
                       {"sharpness_alone", bracket.sharpness_alone},
                       {"frames_seen", bracket.frames.size()},
                       {"frames_used", bracket.used},
                       {"frames_rejected", bracket.rejected},
                       {"frames_missing", 0},
                       {"reference", bracket.reference},
                       {"files", context.files},
                       {"has_labels", bracket.has_labels},
                       {"label_stamp", nullptr},
                       {"optics", context.has_optics ? opticsJson(context.optics) : Json()},
                       {"segments", segments},
                       {"notes", context.notes},
                       {"blur_scale", bracket.blur_scale},
                       {"timing_names", timing_names},
                       {"timing_ms", timing_ms},
                       {"dof_rule", context.dof_rule},
                       {"unknown_area", result.segmentation.unknown_area},
                       {"segment_table", tableJson(result.segmentation, context.optics)}};
  return text(report);
}

std::string segmentationReport(const Segmentation& segmentation, const Optics& optics,
                               const std::string& dof_rule) {
  const Json report = {{"version", kReportVersion},
                       {"optics", opticsJson(optics)},
                       {"dof_rule", dof_rule},
                       {"unknown_area", segmentation.unknown_area},
                       {"segment_table", tableJson(segmentation, optics)},
                       {"focus_plan", planJson(segmentation, optics)}};
  return text(report);
}

}  // namespace all_in_focus
