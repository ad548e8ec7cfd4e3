// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/program_options.hpp>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/pipeline.hpp"
#include "report_json.hpp"
#include "stack_reader.hpp"

/// What the command line of fuse_stack tells about a scene, besides its frames. All functions throw
/// std::invalid_argument that names the option or the file.
namespace all_in_focus {

/// Reads what is known about depth, at most one of three inputs, and rig and optics.
void readScene(const boost::program_options::variables_map& values, PipelineInput& input,
               ReportContext& context);

/// Sizes of pictures that belong to what is known about depth.
std::vector<cv::Size> calibratedSizes(const PipelineInput& input);

/// Reads the focus distances of the frames, if there are some.
void readFocus(const boost::program_options::variables_map& values, StackReader& stack, PipelineInput& input,
               ReportContext& context);

/// Adds notes about inputs that are given and that the mode cannot use.
void explainMissing(const PipelineInput& input, Mode mode, ReportContext& context);

/// Likely mistakes in rig or depth, a line each. Throws where no depth falls into the picture.
std::vector<std::string> checkScene(const boost::program_options::variables_map& values,
                                    const PipelineInput& input, StackReader& stack);

}  // namespace all_in_focus
