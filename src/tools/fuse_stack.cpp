// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The whole method on files: from a focus bracket and what is known about depth to the all-in-focus image.

#include <chrono>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "batch_fusion.hpp"
#include "command_line.hpp"
#include "file_error.hpp"
#include "output_files.hpp"
#include "progress.hpp"
#include "quiet_stderr.hpp"
#include "result_files.hpp"
#include "scene_options.hpp"
#include "stack_batch.hpp"
#include "stack_reader.hpp"

namespace po = boost::program_options;
using namespace all_in_focus;
using namespace all_in_focus::core;

namespace {

const std::vector<const char*> kReads = {"stack", "rig", "depth", "registered-depth", "label-map", "focus"};
const std::vector<const char*> kWrites = {
    "output",       "save-registered",    "save-measured", "save-depth",      "save-labels",
    "save-regions", "save-source-index",  "save-weights",  "save-confidence", "save-cloud",
    "report",       "save-weights-legend"};
constexpr int kAutoReference = BracketSettings::kAutoReference;

int parseReference(const std::string& text) {
  if (text == "auto") return kAutoReference;
  std::size_t used = 0;
  int reference = -1;
  try {
    reference = std::stoi(text, &used);
  } catch (const std::exception&) {
  }
  if (used != text.size() || reference < 0) {
    throw std::invalid_argument("--reference: '" + text + "' is neither auto nor an index from 0 on");
  }
  return reference;
}

// Parses the ingredients of mode refined to leave out, separated by commas.
RefinedConfig parseWithout(const std::string& names) {
  RefinedConfig config;
  const std::map<std::string, bool*> ingredients = {{"alignment", &config.alignment},
                                                    {"exposure", &config.exposure},
                                                    {"prediction", &config.prediction},
                                                    {"scales", &config.scales},
                                                    {"brightness", &config.brightness},
                                                    {"noise", &config.noise},
                                                    {"soft", &config.soft}};
  std::istringstream list(names);
  for (std::string name; std::getline(list, name, ',');) {
    const auto found = ingredients.find(name);
    if (found == ingredients.end()) {
      std::string known;
      for (const auto& ingredient : ingredients) known += " " + ingredient.first;
      throw std::invalid_argument("--without: '" + name + "' is none of" + known);
    }
    *found->second = false;
  }
  return config;
}

// The last line: what was written, and from what.
std::string summary(const std::string& output, const PipelineResult& result, const StackReader& stack,
                    double seconds) {
  const BracketResult& bracket = result.bracket;
  const std::string counted =
      std::to_string(bracket.used) + " of " + std::to_string(bracket.length) + " frames";
  std::string line = "wrote " + output + ": " + counted;
  if (2 * bracket.used < bracket.length)
    line = "only " + counted + " were used, see the notes; wrote " + output;
  if (bracket.length == 1) line = "wrote " + output + ": of one frame, there was nothing to fuse";
  const std::string reference = stack.names().empty()
                                    ? "frame " + std::to_string(bracket.reference)
                                    : stack.names()[static_cast<std::size_t>(bracket.reference)];
  return line + ", reference " + reference + cv::format(", %.1f s", seconds);
}

// What --timings prints.
std::string timings(const PipelineResult& result, Mode mode) {
  const BracketResult& bracket = result.bracket;
  std::ostringstream text;
  text << "depth " << result.depth_ms << " ms, segmentation " << result.segmentation_ms << " ms, fusion "
       << bracket.fusion_ms << " ms for " << bracket.length << " frames ("
       << bracket.fusion_ms / bracket.length << " ms each)";
  if (mode == Mode::kRestored) text << ", restoration " << bracket.restoration_ms << " ms";
  return text.str();
}

// Runs the method, and tells how far it is.
PipelineResult run(const po::variables_map& values, PipelineInput& input, Mode mode, StackReader& stack,
                   const std::string& ahead) {
  Progress progress(ahead);
  const bool counted = mode != Mode::kPaper || !stack.names().empty();
  ToldFrames frames(stack, progress, counted ? stack.count() : 0,
                    mode != Mode::kPaper && input.reference != 0);
  input.frames = &frames;
  input.frame_name = [&stack](int index) { return stack.frameName(index); };
  input.progress = [&, restoring = false](double done) mutable {
    if (!std::exchange(restoring, true)) progress.begin();
    progress.tell(cv::format("restoring, %.0f %% done", 100 * done), done);
    return true;
  };
  try {
    return Pipeline(mode).run(input);
  } catch (const FileError&) {
    throw;
  } catch (const std::invalid_argument& e) {
    // The core says what is wrong; this adds the name of the file.
    const std::string depth = textOption(values, input.depth.empty() ? "registered-depth" : "depth");
    throw std::invalid_argument((stack.current().empty() ? depth : stack.current()) + ": " + e.what());
  }
}

// See FuseStack.
Fused fuseStack(const po::variables_map& values, const NamedStack& of, const std::string& who,
                const std::string& ahead) {
  const auto begin = std::chrono::steady_clock::now();
  requireSeparate(given(values, kReads), given(values, kWrites));
  const Mode mode = parseMode(values["mode"].as<std::string>());
  PipelineInput input;
  ReportContext context;
  input.reference = parseReference(values["reference"].as<std::string>());
  input.refined = parseWithout(textOption(values, "without"));
  readScene(values, input, context);
  StackReader stack(of.path, calibratedSizes(input), of.files);
  context.files = stack.names();
  context.notes = stack.notes();
  readFocus(values, stack, input, context);
  explainMissing(input, mode, context);
  ResultFiles files(values, given(values, kWrites), stack, mode);
  files.prepare(input);
  // Before the first frame is fused: that may take minutes.
  const std::vector<std::string> warnings = checkScene(values, input, stack);
  for (const std::string& warning : warnings) printToStderr(who + "warning: " + warning);

  PipelineResult result = run(values, input, mode, stack, ahead);
  const BracketResult& bracket = result.bracket;
  if (input.focus_mm.size() > bracket.frames.size()) {
    throw std::invalid_argument(textOption(values, "focus") + ": " + std::to_string(input.focus_mm.size()) +
                                " entries for " + std::to_string(bracket.frames.size()) + " frames");
  }
  if (!input.labels.empty() && values["unknown-label"].as<int>() >= 0) {
    result.segmentation.unknown_area =
        static_cast<int>(input.labels.total()) - cv::countNonZero(input.labels);
  }
  context.notes.insert(context.notes.end(), bracket.notes.begin(), bracket.notes.end());
  context.notes.insert(context.notes.begin(), warnings.begin(), warnings.end());
  files.write(input, result, context);

  for (std::size_t i = warnings.size(); i < context.notes.size(); ++i)
    printToStderr(who + "note: " + context.notes[i]);
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin;
  printToStderr(who + summary(textOption(values, "output"), result, stack, passed.count()));
  if (values.count("timings")) std::cout << timings(result, mode) << '\n';
  return {bracket.used, bracket.length};
}

void fuse(const po::variables_map& values) {
  const auto paths = values["stack"].as<std::vector<std::string>>();
  const std::string rule = textOption(values, "split");
  if (paths.size() == 1 && rule.empty() && !holdsStacks(paths[0])) {
    fuseStack(values, {paths[0], "", {}}, "fuse_stack: ", "fuse_stack: ");
    return;
  }
  std::vector<NamedStack> stacks = findStacks(paths);
  if (!rule.empty()) {
    std::vector<NamedStack> parts;
    for (const NamedStack& stack : stacks) {
      const std::vector<NamedStack> of_stack = splitStack(stack, rule);
      parts.insert(parts.end(), of_stack.begin(), of_stack.end());
    }
    stacks = parts;
  }
  fuseStacks(values, stacks, kWrites, fuseStack);
}

}  // namespace

int main(int argc, char** argv) {
  po::options_description options("Options");
  const auto text = [] { return po::value<std::string>(); };
  options.add_options()("stack", po::value<std::vector<std::string>>()->required(),
                        "focus bracket: folder of images, TIFF of several pages or video; several, or a "
                        "folder of such folders: outputs name "
                        "folders, files in them have the names of the stacks")  //
      ("split", text(),
       "the folder holds many brackets: N frames each, or gap: each ends with a longer pause or a change of "
       "scene")  //
      ("output", text()->required(), "all-in-focus image; its ending chooses the format")(
          "quality", po::value<int>()->default_value(kDefaultQuality), "of JPEG and WebP, 1 to 100")(
          "depth-of-output", text()->default_value("auto"),
          "bits of a value of the all-in-focus image: 8, 16, or auto: as the frames")(
          "width", po::value<int>(),
          "width of the all-in-focus image, for a quick look; default: that of the frames")(
          "crop", "cut off the border that not all frames show, of all pictures of the frames' size")(
          "save-aligned", text(),
          "folder for the frames as they are fused, PNG; alpha is 0 where a frame saw nothing")  //
      ("rig", text(), "rig folder: depth.yaml, color.yaml, extrinsics.yaml, optics.yaml")        //
      ("depth", text(), "depth of the sensor, 16-bit PNG, mm, 0 = unknown; needs --rig")         //
      ("registered-depth", text(), "depth seen from the colour camera instead, 16-bit PNG, mm")  //
      ("invalid-values", text()->default_value("0,65535"), "depths that mean unknown, mm")(
          "label-map", text(), "regions instead of depth: every distinct value is one")  //
      ("unknown-label", po::value<int>()->default_value(-1),
       "value of the label map that means unknown, -1 = none")                                           //
      ("optics", text(), "f,F,coc in mm, as in 24,4,0.019 (default: optics.yaml of the rig folder)")     //
      ("dof-rule", text()->default_value("paper"), "dioptre span of a region: paper = 1/H, full = 2/H")  //
      ("focus", text(), "YAML: focus distance of each frame")                                            //
      ("mode", text()->default_value("refined"), "paper, refined or restored")                           //
      ("without", text(),
       "ingredients of mode refined to leave out: alignment, exposure, prediction, "
       "scales, brightness, noise, soft")  //
      ("reference", text()->default_value("auto"),
       "frame whose geometry and exposure the result keeps; auto: the middle one")                          //
      ("save-registered", text(), "depth seen from the colour camera, holes filled, 16-bit PNG, mm")        //
      ("save-measured", text(), "the same before its holes were filled, 16-bit PNG, mm")                    //
      ("save-depth", text(), "depth estimated from the bracket by mode restored, 16-bit PNG, mm")           //
      ("save-labels", text(), "label image, 16-bit PNG")                                                    //
      ("save-regions", text(), "picture of the regions for people: red is near; captions and legend in m")  //
      ("save-source-index", text(), "frame that each pixel was taken from, 16-bit PNG, 65535 = none")       //
      ("save-weights", text(), "picture of which frame won where: hue = frame, brightness = confidence")    //
      ("save-weights-legend", text(), "picture of the frames' hues in it, with file and focus distance")    //
      ("save-confidence", text(), "how clear the choice was, 8-bit PNG, 255 = no rival")                    //
      ("save-cloud", text(),
       "points with colour, metres, in the colour camera's frame, binary PLY; by the depth of mode restored "
       "where there is one")("report", text(), "JSON report")  //
      ("timings", "print how long each step took");
  runTool(argc, argv, options,
          {"all-in-focus image of a focus bracket, assisted by depth", kReads, kWrites, fuse, "stack",
           /*separates=*/true});
}
