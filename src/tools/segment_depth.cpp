// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Cuts a registered depth map into regions that each fit inside one depth of field.

#include "all_in_focus/drawing.hpp"
#include "command_line.hpp"
#include "image_files.hpp"
#include "output_files.hpp"
#include "report_json.hpp"
#include "rig_files.hpp"

namespace po = boost::program_options;
using namespace all_in_focus;
using namespace all_in_focus::core;

namespace {

void segmentDepth(const po::variables_map& values) {
  const Optics optics = parseOptics(values["optics"].as<std::string>());
  const std::string rule = values["dof-rule"].as<std::string>();
  const Mode mode = parseMode(values["mode"].as<std::string>());
  Segmentation result;
  DofSegmentation(segmentationConfig(mode, optics, parseDofSpan(rule), values["min-region-size"].as<int>()))
      .compute(readDepth(values["depth"].as<std::string>(),
                         parseInvalidValues(values["invalid-values"].as<std::string>())),
               result);

  OutputFiles outputs;
  outputs.addImage(values["output"].as<std::string>(), labels16(result.labels));
  if (values.count("save-regions")) {
    cv::Mat regions;
    drawRegions(result, captionRegions(result), regions);
    outputs.addImage(textOption(values, "save-regions"), regions);
  }
  if (values.count("report")) {
    outputs.addText(textOption(values, "report"), segmentationReport(result, optics, rule));
  }
  outputs.commit();
}

}  // namespace

int main(int argc, char** argv) {
  po::options_description options("Options");
  options.add_options()("depth", po::value<std::string>()->required(),
                        "registered depth, 16-bit PNG, mm, 0 = unknown")                   //
      ("optics", po::value<std::string>()->required(), "f,F,coc in mm, as in 24,4,0.019")  //
      ("output", po::value<std::string>()->required(),
       "label image, 16-bit PNG, 0 = unknown, 1.. near to far")  //
      ("invalid-values", po::value<std::string>()->default_value("0,65535"), "depths that mean unknown, mm")(
          "save-regions", po::value<std::string>(),
          "picture of the regions for people: red is near; captions and legend in m")  //
      ("report", po::value<std::string>(), "JSON with the table of regions")           //
      ("dof-rule", po::value<std::string>()->default_value("paper"),
       "dioptre span of a region: paper = 1/H, full = 2/H")  //
      ("mode", po::value<std::string>()->default_value("refined"),
       "paper: small regions are merged whatever the rule says; refined: they stay")  //
      ("min-region-size", po::value<int>()->default_value(SegmentationConfig().min_region_size),
       "what is small, pixels (mode paper)");
  runTool(argc, argv, options,
          {"regions of a depth map that each fit inside one depth of field",
           {"depth"},
           {"output", "save-regions", "report"},
           segmentDepth});
}
