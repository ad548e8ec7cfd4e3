// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/program_options.hpp>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "aligned_frames.hpp"
#include "all_in_focus/pipeline.hpp"
#include "output_files.hpp"
#include "report_json.hpp"
#include "stack_reader.hpp"

namespace all_in_focus {

/// The options of fuse_stack on which its picture depends, as text: "fuse_stack --mode refined --crop". Of a
/// rig it has the name only, for the text becomes a part of the picture.
std::string optionsText(const boost::program_options::variables_map& values);

/// The files that the command line of fuse_stack asks for. They appear all together at the end, or none does.
class ResultFiles {
 public:
  /// Throws std::invalid_argument where an option is impossible or a frame would be replaced, before the
  /// first one is fused: that may take minutes. outputs: those that the values name. Values and stack must
  /// outlive the object.
  ResultFiles(const boost::program_options::variables_map& values, std::vector<NamedPath> outputs,
              const StackReader& stack, Mode mode);
  ResultFiles(const ResultFiles&) = delete;
  ResultFiles& operator=(const ResultFiles&) = delete;

  /// Asks the pipeline for what the files need.
  void prepare(PipelineInput& input);

  /// Adds notes about the files to the context. Throws std::invalid_argument where the result lacks what is
  /// asked for, FileError where a file cannot be written.
  void write(const PipelineInput& input, const PipelineResult& result, ReportContext& context);

 private:
  void findCrop(const BracketResult& bracket, std::vector<std::string>& notes);
  cv::Mat cropped(const cv::Mat& picture) const;
  cv::Mat ofBits(const cv::Mat& image, std::vector<std::string>& notes) const;
  /// missing: what there is not if the image is empty.
  void add(const char* option, const cv::Mat& image, const char* missing);
  void addDepth(const PipelineResult& result, std::vector<std::string>& notes);
  void addRegions(const Segmentation& segmentation);
  void addChoice(const BracketResult& bracket, const std::vector<double>& focus_mm);
  void addCloud(const PipelineResult& result, const Camera& camera);

  const boost::program_options::variables_map& values_;
  const StackReader& stack_;
  const Mode mode_;
  const int quality_, bits_, width_;
  OutputFiles outputs_;
  AlignedFrames aligned_;
  cv::Size size_;  // of the frames
  cv::Rect crop_;  // empty: nothing is cut off
};

}  // namespace all_in_focus
