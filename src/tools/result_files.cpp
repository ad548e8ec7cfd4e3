// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "result_files.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/drawing.hpp"
#include "command_line.hpp"
#include "image_files.hpp"
#include "point_cloud.hpp"

namespace po = boost::program_options;

namespace all_in_focus {
namespace {

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

int parseQuality(const po::variables_map& values) {
  const int quality = values["quality"].as<int>();
  if (quality < 1 || quality > 100) throw std::invalid_argument("--quality must be from 1 to 100");
  return quality;
}

// 8 or 16; 0: as the frames.
int parseBits(const po::variables_map& values) {
  const auto bits = values["depth-of-output"].as<std::string>();
  if (bits == "auto") return 0;
  if (bits != "8" && bits != "16")
    throw std::invalid_argument("--depth-of-output: '" + bits + "' is none of 8, 16 and auto");
  return std::stoi(bits);
}

// Of the result, for a quick look; 0: that of the frames.
int parseWidth(const po::variables_map& values) {
  if (!values.count("width")) return 0;
  const int width = values["width"].as<int>();
  if (width <= 0) throw std::invalid_argument("--width must be a positive number of pixels");
  return width;
}

// Never enlarged.
cv::Mat ofWidth(const cv::Mat& image, int width) {
  if (width == 0 || width >= image.cols) return image;
  cv::Mat small;
  cv::resize(image, small, {width, std::max(1, cvRound(double(image.rows) * width / image.cols))}, 0, 0,
             cv::INTER_AREA);
  return small;
}

}  // namespace

std::string optionsText(const po::variables_map& values) {
  std::string text = "fuse_stack";
  for (const char* name : {"rig", "optics", "invalid-values", "dof-rule", "mode", "without", "reference",
                           "quality", "depth-of-output", "width", "crop"}) {
    if (!values.count(name)) continue;
    const boost::any& value = values[name].value();
    text += std::string(" --") + name;
    if (const auto* number = boost::any_cast<int>(&value)) text += " " + std::to_string(*number);
    if (const auto* given = boost::any_cast<std::string>(&value); given && !given->empty())
      text += " " + std::filesystem::path(*given + "/.").parent_path().filename().string();
  }
  return text;
}

ResultFiles::ResultFiles(const po::variables_map& values, std::vector<NamedPath> outputs,
                         const StackReader& stack, Mode mode)
    : values_(values),
      stack_(stack),
      mode_(mode),
      quality_(parseQuality(values)),
      bits_(parseBits(values)),
      width_(parseWidth(values)),
      aligned_(outputs_, textOption(values, "save-aligned"), stack.names()) {
  // Earlier results are frames, too, where the folder holds nothing else.
  std::vector<NamedPath> frames;
  frames.reserve(stack.names().size());
  for (int i = 0; i < static_cast<int>(stack.names().size()); ++i) frames.push_back({"stack", stack.path(i)});
  const std::vector<NamedPath> aligned = aligned_.paths();
  outputs.insert(outputs.end(), aligned.begin(), aligned.end());
  requireSeparate(frames, outputs);
  if (values.count("save-aligned") && mode == Mode::kPaper)
    throw std::invalid_argument("--save-aligned: mode paper aligns no frames");
}

void ResultFiles::prepare(PipelineInput& input) {
  const auto wants = [this](const char* option) { return values_.count(option) > 0; };
  input.refined.choice =
      wants("save-source-index") || wants("save-confidence") || wants("save-weights") || wants("report");
  if (wants("save-aligned") || wants("crop"))
    input.on_aligned = [this](const AlignedFrame& frame) { aligned_.add(frame); };
}

void ResultFiles::write(const PipelineInput& input, const PipelineResult& result, ReportContext& context) {
  findCrop(result.bracket, context.notes);
  const cv::Mat image = cropped(ofBits(result.bracket.image, context.notes));
  outputs_.addImage(textOption(values_, "output"), ofWidth(image, width_),
                    {stack_.path(result.bracket.reference), namesText(stack_.names()), stack_.orientation(),
                     optionsText(values_)},
                    quality_);
  addDepth(result, context.notes);
  addRegions(result.segmentation);
  addChoice(result.bracket, input.focus_mm);
  if (values_.count("save-cloud")) addCloud(result, input.rig.color);
  if (values_.count("report")) outputs_.addText(textOption(values_, "report"), fusionReport(result, context));
  outputs_.commit();
  aligned_.commit();
}

void ResultFiles::findCrop(const BracketResult& bracket, std::vector<std::string>& notes) {
  const cv::Rect shown = aligned_.finish(bracket);
  size_ = bracket.image.size();
  if (!values_.count("crop") || shown.size() == size_) return;
  if (shown.empty()) throw std::invalid_argument("--crop: no part of the picture is shown by all frames");
  crop_ = shown;
  notes.push_back(cv::format("cropped to %dx%d at %d, %d, which all frames show", shown.width, shown.height,
                             shown.x, shown.y));
}

cv::Mat ResultFiles::cropped(const cv::Mat& picture) const {
  return !crop_.empty() && picture.size() == size_ ? picture(crop_) : picture;
}

// As the frames if the format holds them; else a note says so.
cv::Mat ResultFiles::ofBits(const cv::Mat& image, std::vector<std::string>& notes) const {
  if (bits_ == 8) return toEightBits(image);
  if (bits_ == 16) return toBits(image, CV_16U);
  const std::string path = textOption(values_, "output");
  if (image.depth() == CV_8U || holdsSixteenBits(path)) return image;
  notes.push_back(path + ": this format holds 8 of the 16 bits of the frames (.png and .tif hold all)");
  return toEightBits(image);
}

void ResultFiles::add(const char* option, const cv::Mat& image, const char* missing) {
  const std::string path = textOption(values_, option);
  if (path.empty()) return;
  if (image.empty()) throw std::invalid_argument(std::string("--") + option + ": there is no " + missing);
  outputs_.addImage(path, cropped(image));
}

void ResultFiles::addDepth(const PipelineResult& result, std::vector<std::string>& notes) {
  constexpr const char* kNone = "depth: give --depth or --registered-depth";
  add("save-registered", result.filled, kNone);
  add("save-measured", result.registered, kNone);
  const cv::Mat& restored = result.bracket.restored_depth;
  if (mode_ == Mode::kRestored && restored.empty() && values_.count("save-depth")) {
    notes.emplace_back("--save-depth: nothing is written, for no depth in mm was found");
  } else {
    add("save-depth", restored, "depth from the bracket: only --mode restored estimates it");
  }
}

void ResultFiles::addRegions(const Segmentation& segmentation) {
  if (values_.count("save-labels")) {
    const cv::Mat& labels = segmentation.labels;
    add("save-labels", labels.empty() ? labels : labels16(labels),
        "label image: give --depth, --registered-depth or --label-map");
  }
  if (!values_.count("save-regions")) return;
  cv::Mat regions;
  if (!segmentation.segments.empty()) drawRegions(segmentation, captionRegions(segmentation), regions);
  add("save-regions", regions, "region with a depth: give --depth or --registered-depth");
}

// Which frame won where.
void ResultFiles::addChoice(const BracketResult& bracket, const std::vector<double>& focus_mm) {
  add("save-source-index", bracket.source_index, "source index");
  add("save-confidence", bracket.confidence, "confidence");
  if (values_.count("save-weights")) {
    cv::Mat weights;
    drawWeights(bracket.source_index, bracket.confidence, bracket.length, weights);
    add("save-weights", weights, "weights");
  }
  if (!values_.count("save-weights-legend")) return;
  cv::Mat legend;
  drawWeightsLegend(describeFrames(stack_.names(), focus_mm, bracket.length), legend);
  outputs_.addImage(textOption(values_, "save-weights-legend"), legend);
}

void ResultFiles::addCloud(const PipelineResult& result, const Camera& camera) {
  const cv::Mat& restored = result.bracket.restored_depth;
  const cv::Mat& depth = restored.empty() ? result.registered : restored;
  if (depth.empty())
    throw std::invalid_argument("--save-cloud: there is no depth: give --depth or --registered-depth");
  outputs_.addText(textOption(values_, "save-cloud"),
                   pointCloudPly(toEightBits(result.bracket.image), depth, camera));
}

}  // namespace all_in_focus
