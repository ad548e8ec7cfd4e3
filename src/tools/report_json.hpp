// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "all_in_focus/pipeline.hpp"

namespace all_in_focus {

using namespace core;

/// What a report needs beyond the pipeline's result.
struct ReportContext {
  std::vector<std::string> files;  ///< names of the frames, by index; empty: of a video
  std::string dof_rule = "paper";
  bool has_optics = false;  ///< regions were cut for the optics
  Optics optics;
  std::vector<std::string> notes;
};

/// report.json of one bracket: the field names of FusionReport.msg, the regions as `segment_table` with those
/// of Segment.msg. Metres; null = infinite or unknown.
std::string fusionReport(const PipelineResult& result, const ReportContext& context);

/// Report of a segmentation alone: optics, dof_rule, unknown_area, `segment_table` and `focus_plan` (one
/// entry an exposure, with the field names of FocusPlan.msg).
std::string segmentationReport(const Segmentation& segmentation, const Optics& optics,
                               const std::string& dof_rule);

}  // namespace all_in_focus
