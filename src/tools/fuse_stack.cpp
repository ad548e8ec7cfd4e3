// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The whole method on files: from a focus bracket and what is known about depth to the all-in-focus image.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <map>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <utility>

#include "aligned_frames.hpp"
#include "all_in_focus/codes.hpp"
#include "all_in_focus/drawing.hpp"
#include "all_in_focus/rig_checks.hpp"
#include "batch_fusion.hpp"
#include "command_line.hpp"
#include "file_error.hpp"
#include "image_files.hpp"
#include "output_files.hpp"
#include "point_cloud.hpp"
#include "progress.hpp"
#include "quiet_stderr.hpp"
#include "report_json.hpp"
#include "rig_files.hpp"
#include "rig_warnings.hpp"
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

// A line for each frame: index, file, focus distance, as far as they are known. distances: mm.
std::vector<std::string> describeFrames(const std::vector<std::string>& files,
                                        const std::vector<double>& distances, int count) {
  std::vector<std::string> lines;
  for (int i = 0; i < count; ++i) {
    const auto index = static_cast<std::size_t>(i);
    std::string line = std::to_string(i);
    if (index < files.size()) line += ": " + files[index];
    if (index < distances.size() && !std::isnan(distances[index]))
      line += std::isinf(distances[index]) ? ", infinity" : cv::format(", %.3g m", distances[index] / 1000);
    lines.push_back(line);
  }
  return lines;
}

// Parses the ingredients of mode refined to leave out, separated by commas.
RefinedConfig parseWithout(const std::string& names) {
  RefinedConfig config;
  const std::map<std::string, bool*> ingredients = {{"alignment", &config.alignment},
                                                    {"exposure", &config.exposure},
                                                    {"prediction", &config.prediction},
                                                    {"edge-error", &config.defocus.edge_uncertainty},
                                                    {"hole-doubt", &config.defocus.hole_doubt},
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

// Adds notes about inputs that mode refined lacks.
void explainMissing(const PipelineInput& input, Mode mode, ReportContext& context) {
  if (mode == Mode::kPaper) {
    if (input.depth.empty() && input.registered_depth.empty() && input.labels.empty())
      context.notes.push_back("mode paper needs depth or a label map: fused by sharpness alone");
    return;
  }
  const bool has_depth = !input.depth.empty() || !input.registered_depth.empty();
  const auto without = [&](const std::string& missing) {
    context.notes.push_back(missing + ": depth and lens data are not used");
  };
  const bool aligns_by_lens = input.has_rig && !input.focus_mm.empty();
  if (!has_depth && input.labels.empty() && context.has_optics && !aligns_by_lens) {
    context.notes.emplace_back(input.has_rig ? "neither depth nor focus distances: the rig is not used"
                                             : "no depth: the lens is not used");
  } else if (!has_depth && !input.labels.empty()) {
    without("a label map tells no distances");
  } else if (has_depth && !input.has_rig) {
    without("no rig, the pixel pitch is unknown");
  }
}

// Reads what is known about depth, at most one of three inputs, and rig and optics.
void readDepthInput(const po::variables_map& values, PipelineInput& input, ReportContext& context) {
  const std::string depth = textOption(values, "depth"), registered = textOption(values, "registered-depth"),
                    labels = textOption(values, "label-map"), rig = textOption(values, "rig");
  if (!depth.empty() + !registered.empty() + !labels.empty() > 1) {
    throw std::invalid_argument("give one of --depth, --registered-depth and --label-map");
  }
  if (!depth.empty() && rig.empty())
    throw std::invalid_argument("--depth needs --rig: the calibration that registers it");
  input.has_rig = !rig.empty();
  if (input.has_rig) input.rig = readRig(rig);

  const std::string optics = textOption(values, "optics");
  const bool segments = !depth.empty() || !registered.empty();
  if (!optics.empty()) {
    input.optics = parseOptics(optics);
    // The rig was calibrated with its own lens, if it tells one.
    if (input.has_rig && hasOptics(rig))
      input.pixel_pitch_mm = readOptics(rig).focal_length_mm / input.rig.color.fx;
  } else if (!rig.empty()) {
    input.optics = readOptics(rig);
  } else if (segments) {
    throw std::invalid_argument(
        "--optics f,F,coc is needed: without a rig folder the depth of field is unknown");
  }
  if (values.count("save-cloud") && rig.empty())
    throw std::invalid_argument("--save-cloud needs --rig: the calibration of the colour camera");
  context.has_optics = !optics.empty() || !rig.empty();
  context.optics = input.optics;

  const std::vector<int> invalid = parseInvalidValues(values["invalid-values"].as<std::string>());
  if (!depth.empty()) input.depth = readDepth(depth, invalid);
  if (!registered.empty()) input.registered_depth = readDepth(registered, invalid);
  if (!labels.empty()) input.labels = readLabelMap(labels, values["unknown-label"].as<int>());
}

// Likely mistakes in rig or depth, one line each.
std::vector<std::string> checkRigAndDepth(const PipelineInput& input, StackReader& stack) {
  const auto picture = [&stack] { return stack.glance(); };
  if (!input.depth.empty()) {
    const RigWarnings found = checkRig(input.rig, &input.optics, input.depth, picture);
    if (found.apart) throw std::invalid_argument(found.overlap);
    return found.lines();
  }
  if (input.registered_depth.empty()) return {};
  RigWarnings found;
  found.unit = checkDepthUnit(input.registered_depth);
  if (input.has_rig) {
    found.circle_of_confusion = checkCircleOfConfusion(input.optics, input.rig.color);
    found.color_center = checkPrincipalPoint(input.rig.color, "colour");
  }
  found.mirroring = checkMirroring(input.registered_depth, cv::Mat(), picture());
  return found.lines();
}

// Warns before the first frame is fused: that may take minutes.
std::vector<std::string> warnOfRig(const po::variables_map& values, const PipelineInput& input,
                                   StackReader& stack, const std::string& who) {
  std::vector<std::string> warnings;
  try {
    warnings = checkRigAndDepth(input, stack);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(textOption(values, "depth") + ": " + e.what());
  }
  for (const std::string& warning : warnings) printToStderr(who + "warning: " + warning);
  return warnings;
}

// Refuses focus distances up to the focal length: no lens can be focused there.
void checkFocus(const std::string& path, const std::vector<double>& distances, const Optics& optics) {
  for (const double focus : distances) {
    if (focus <= optics.focal_length_mm) {
      throw std::invalid_argument(path + cv::format(": focus_mm %g is not beyond the focal length, %g mm",
                                                    focus, optics.focal_length_mm));
    }
  }
}

// Sizes of pictures that belong to what is known about depth.
std::vector<cv::Size> calibratedSizes(const PipelineInput& input) {
  std::vector<cv::Size> sizes;
  if (input.has_rig) sizes.push_back(input.rig.color.size);
  for (const cv::Mat* map : {&input.registered_depth, &input.labels}) {
    if (!map->empty()) sizes.push_back(map->size());
  }
  return sizes;
}

int parseQuality(const po::variables_map& values) {
  const int quality = values["quality"].as<int>();
  if (quality < 1 || quality > 100) throw std::invalid_argument("--quality must be from 1 to 100");
  return quality;
}

// The result with 8 or 16 bits. auto: as the frames, if the format holds them; else a note says so.
cv::Mat ofDepth(const cv::Mat& image, const std::string& depth, const std::string& path,
                std::vector<std::string>& notes) {
  if (depth != "auto" && depth != "8" && depth != "16")
    throw std::invalid_argument("--depth-of-output: '" + depth + "' is none of 8, 16 and auto");
  if (depth == "8") return toEightBits(image);
  if (depth == "16") return toBits(image, CV_16U);
  if (image.depth() == CV_8U || holdsSixteenBits(path)) return image;
  notes.push_back(path + ": this format holds 8 of the 16 bits of the frames (.png and .tif hold all)");
  return toEightBits(image);
}

// The result for a quick look: of that width, but never enlarged.
cv::Mat ofWidth(const cv::Mat& image, int width) {
  if (width <= 0) throw std::invalid_argument("--width must be a positive number of pixels");
  if (width >= image.cols) return image;
  cv::Mat small;
  cv::resize(image, small, {width, std::max(1, cvRound(double(image.rows) * width / image.cols))}, 0, 0,
             cv::INTER_AREA);
  return small;
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

// See FuseStack.
Fused fuseStack(const po::variables_map& values, const NamedStack& of, const std::string& who,
                const std::string& ahead) {
  const auto begin = std::chrono::steady_clock::now();
  requireSeparateFiles(values, kReads, kWrites);
  const int quality = parseQuality(values);
  const Mode mode = parseMode(values["mode"].as<std::string>());
  PipelineInput input;
  ReportContext context;
  readDepthInput(values, input, context);
  context.mode = mode;
  context.dof_rule = values["dof-rule"].as<std::string>();
  input.span = parseDofSpan(context.dof_rule);

  StackReader stack(of.path, calibratedSizes(input), of.files);
  context.files = stack.names();
  context.notes.insert(context.notes.end(), stack.notes().begin(), stack.notes().end());
  const std::string focus = textOption(values, "focus");
  const std::vector<double> distances =
      focus.empty() ? std::vector<double>() : readFocus(focus, stack.names(), stack.leftOut(), stack.count());
  if (context.has_optics) checkFocus(focus, distances, input.optics);
  const auto known =
      std::count_if(distances.begin(), distances.end(), [](double mm) { return !std::isnan(mm); });
  if (!focus.empty() && known < stack.count())
    context.notes.push_back(
        focus + cv::format(": tells the focus distance of %td of %d frames", known, stack.count()));
  input.focus_mm = distances;
  input.reference = parseReference(values["reference"].as<std::string>());
  input.refined = parseWithout(textOption(values, "without"));
  input.refined.choice = values.count("save-source-index") || values.count("save-confidence") ||
                         values.count("save-weights") || values.count("report");
  explainMissing(input, mode, context);

  const std::vector<std::string> warnings = warnOfRig(values, input, stack, who);
  OutputFiles outputs;
  AlignedFrames aligned(outputs, textOption(values, "save-aligned"), stack.names());
  requireSeparate({{"stack", of.path}}, aligned.paths());
  if (values.count("save-aligned") && mode == Mode::kPaper)
    throw std::invalid_argument("--save-aligned: mode paper aligns no frames");
  if (values.count("save-aligned") || values.count("crop"))
    input.on_aligned = [&aligned](const AlignedFrame& frame) { aligned.add(frame); };

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
  PipelineResult result;
  try {
    result = Pipeline(mode).run(input);
  } catch (const FileError&) {
    throw;
  } catch (const std::invalid_argument& e) {
    // The core says what is wrong; this adds the name of the file.
    const std::string depth = textOption(values, input.depth.empty() ? "registered-depth" : "depth");
    throw std::invalid_argument((stack.current().empty() ? depth : stack.current()) + ": " + e.what());
  }
  progress.end();
  const BracketResult& bracket = result.bracket;
  if (distances.size() > bracket.frames.size()) {
    throw std::invalid_argument(focus + ": " + std::to_string(distances.size()) + " entries for " +
                                std::to_string(bracket.frames.size()) + " frames");
  }
  context.notes.insert(context.notes.end(), bracket.notes.begin(), bracket.notes.end());
  context.notes.insert(context.notes.begin(), warnings.begin(), warnings.end());
  if (!input.labels.empty() && values["unknown-label"].as<int>() >= 0) {
    result.segmentation.unknown_area =
        static_cast<int>(input.labels.total()) - cv::countNonZero(input.labels);
  }

  const cv::Rect shown = aligned.finish(bracket);
  const cv::Size size = bracket.image.size();
  const bool crops = values.count("crop") && shown.size() != size;
  if (crops) {
    if (shown.empty()) throw std::invalid_argument("--crop: no part of the picture is shown by all frames");
    context.notes.push_back(cv::format("cropped to %dx%d at %d, %d, which all frames show", shown.width,
                                       shown.height, shown.x, shown.y));
  }
  const auto cropped = [&](const cv::Mat& picture) {
    return crops && picture.size() == size ? picture(shown) : picture;
  };
  const std::string output = values["output"].as<std::string>();
  cv::Mat image =
      cropped(ofDepth(bracket.image, values["depth-of-output"].as<std::string>(), output, context.notes));
  if (values.count("width")) image = ofWidth(image, values["width"].as<int>());
  outputs.addImage(output, image, {stack.path(bracket.reference), stack.names(), stack.orientation()},
                   quality);
  const auto save = [&](const char* option, const cv::Mat& image, const char* missing) {
    const std::string path = textOption(values, option);
    if (path.empty()) return;
    if (image.empty()) throw std::invalid_argument(std::string("--") + option + ": there is no " + missing);
    outputs.addImage(path, cropped(image));
  };
  save("save-registered", result.filled, "depth: give --depth or --registered-depth");
  save("save-measured", result.registered, "depth: give --depth or --registered-depth");
  if (mode != Mode::kRestored || !bracket.restored_depth.empty()) {
    save("save-depth", bracket.restored_depth, "depth from the bracket: only --mode restored estimates it");
  } else if (!textOption(values, "save-depth").empty()) {
    context.notes.emplace_back("--save-depth: nothing is written, for no depth in mm was found");
  }
  const bool wants_labels = !textOption(values, "save-labels").empty();
  save("save-labels",
       wants_labels && !result.segmentation.labels.empty() ? labels16(result.segmentation.labels) : cv::Mat(),
       "label image: give --depth, --registered-depth or --label-map");
  if (values.count("save-regions")) {
    cv::Mat regions;
    if (!result.segmentation.segments.empty())
      drawRegions(result.segmentation, captionRegions(result.segmentation), regions);
    save("save-regions", regions, "region with a depth: give --depth or --registered-depth");
  }
  save("save-source-index", bracket.source_index, "source index");
  save("save-confidence", bracket.confidence, "confidence");
  if (values.count("save-weights")) {
    cv::Mat weights;
    drawWeights(bracket.source_index, bracket.confidence, bracket.length, weights);
    save("save-weights", weights, "weights");
  }
  if (values.count("save-weights-legend")) {
    cv::Mat legend;
    drawWeightsLegend(describeFrames(stack.names(), distances, bracket.length), legend);
    outputs.addImage(textOption(values, "save-weights-legend"), legend);
  }
  if (values.count("save-cloud")) {
    const cv::Mat& depth = bracket.restored_depth.empty() ? result.registered : bracket.restored_depth;
    if (depth.empty())
      throw std::invalid_argument("--save-cloud: there is no depth: give --depth or --registered-depth");
    outputs.addText(textOption(values, "save-cloud"),
                    pointCloudPly(toEightBits(bracket.image), depth, input.rig.color));
  }
  if (values.count("report")) outputs.addText(textOption(values, "report"), fusionReport(result, context));
  outputs.commit();
  aligned.commit();

  for (std::size_t i = warnings.size(); i < context.notes.size(); ++i)
    printToStderr(who + "note: " + context.notes[i]);
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin;
  printToStderr(who + summary(output, result, stack, passed.count()));
  if (values.count("timings")) {
    std::cout << "depth " << result.depth_ms << " ms, segmentation " << result.segmentation_ms
              << " ms, fusion " << bracket.fusion_ms << " ms for " << bracket.length << " frames ("
              << bracket.fusion_ms / bracket.length << " ms each)";
    if (mode == Mode::kRestored) std::cout << ", restoration " << bracket.restoration_ms << " ms";
    std::cout << '\n';
  }
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
       "ingredients of mode refined to leave out: alignment, exposure, prediction, edge-error, hole-doubt, "
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
