// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "scene_options.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "all_in_focus/rig_checks.hpp"
#include "command_line.hpp"
#include "image_files.hpp"
#include "rig_files.hpp"
#include "rig_warnings.hpp"

namespace po = boost::program_options;

namespace all_in_focus {
namespace {

// Likely mistakes in rig or depth, one line each.
std::vector<std::string> mistakesIn(const PipelineInput& input, StackReader& stack) {
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

// Refuses focus distances up to the focal length: no lens can be focused there.
void checkFocus(const std::string& path, const std::vector<double>& distances, const Optics& optics) {
  for (const double focus : distances) {
    if (focus <= optics.focal_length_mm) {
      constexpr double kMostMetres = 10;  // fewer mm are none
      throw std::invalid_argument(path + cv::format(": focus_mm %g is not beyond the focal length, %g mm%s",
                                                    focus, optics.focal_length_mm,
                                                    focus < kMostMetres ? ": is it in m?" : ""));
    }
  }
}

}  // namespace

void readScene(const po::variables_map& values, PipelineInput& input, ReportContext& context) {
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
  context.dof_rule = values["dof-rule"].as<std::string>();
  input.span = parseDofSpan(context.dof_rule);

  const std::vector<int> invalid = parseInvalidValues(values["invalid-values"].as<std::string>());
  if (!depth.empty()) input.depth = readDepth(depth, invalid);
  if (!registered.empty()) input.registered_depth = readDepth(registered, invalid);
  if (!labels.empty()) input.labels = readLabelMap(labels, values["unknown-label"].as<int>());
}

std::vector<cv::Size> calibratedSizes(const PipelineInput& input) {
  std::vector<cv::Size> sizes;
  if (input.has_rig) sizes.push_back(input.rig.color.size);
  for (const cv::Mat* map : {&input.registered_depth, &input.labels}) {
    if (!map->empty()) sizes.push_back(map->size());
  }
  return sizes;
}

void readFocus(const po::variables_map& values, StackReader& stack, PipelineInput& input,
               ReportContext& context) {
  const std::string path = textOption(values, "focus");
  if (path.empty()) return;
  input.focus_mm = readFocus(path, stack.names(), stack.leftOut(), stack.count());
  if (context.has_optics) checkFocus(path, input.focus_mm, input.optics);
  const auto known =
      std::count_if(input.focus_mm.begin(), input.focus_mm.end(), [](double mm) { return !std::isnan(mm); });
  if (known < stack.count())
    context.notes.push_back(
        path + cv::format(": tells the focus distance of %td of %d frames", known, stack.count()));
}

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

std::vector<std::string> checkScene(const po::variables_map& values, const PipelineInput& input,
                                    StackReader& stack) {
  try {
    return mistakesIn(input, stack);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(textOption(values, "depth") + ": " + e.what());
  }
}

}  // namespace all_in_focus
