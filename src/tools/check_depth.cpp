// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Registers a depth image and finds likely mistakes in it and in its rig, for the programs in Python.

#include <iostream>
#include <nlohmann/json.hpp>

#include "all_in_focus/rig_checks.hpp"
#include "command_line.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"
#include "rig_warnings.hpp"

namespace po = boost::program_options;
using namespace all_in_focus;

namespace {

void checkDepth(const po::variables_map& values) {
  const Rig rig = readRig(values["rig"].as<std::string>());
  const std::string lens = textOption(values, "optics"), color = textOption(values, "color");
  Optics optics;
  if (!lens.empty()) optics = parseOptics(lens);
  const auto picture = [&color] { return color.empty() ? cv::Mat() : readColor(color); };
  const RigWarnings found =
      checkRig(rig, lens.empty() ? nullptr : &optics, readDepth(values["depth"].as<std::string>()), picture);
  if (values.count("save-registered")) {
    OutputFiles outputs;
    outputs.addImage(textOption(values, "save-registered"), found.registered);
    outputs.commit();
  }
  nlohmann::ordered_json report;
  report["unit"] = found.unit;
  report["circle_of_confusion"] = found.circle_of_confusion;
  report["depth_center"] = found.depth_center;
  report["color_center"] = found.color_center;
  report["pose"] = found.pose;
  report["overlap"] = found.overlap;
  report["mirroring"] = found.mirroring;
  report["apart"] = found.apart;
  report["coverage"] = coverage(found.registered, rig);
  std::cout << report.dump(2) << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  po::options_description options("Options");
  const auto text = [] { return po::value<std::string>(); };
  options.add_options()("rig", text()->required(), "rig folder: depth.yaml, color.yaml, extrinsics.yaml")  //
      ("depth", text()->required(), "depth of the sensor, 16-bit PNG, mm, 0 = unknown")                    //
      ("color", text(), "picture of the colour camera, of any resolution: is depth mirrored?")             //
      ("optics", text(), "f,F,coc in mm, as in 24,4,0.019")                                                //
      ("save-registered", text(), "depth seen from the colour camera, holes as they are, 16-bit PNG, mm");
  runTool(argc, argv, options,
          {"what is most likely wrong with a rig and a depth image, as JSON",
           {"rig", "depth", "color"},
           {"save-registered"},
           checkDepth});
}
