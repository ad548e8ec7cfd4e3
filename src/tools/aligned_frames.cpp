// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "aligned_frames.hpp"

#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <set>

#include "file_error.hpp"
#include "photo_metadata.hpp"

namespace fs = std::filesystem;

namespace all_in_focus {

AlignedFrames::AlignedFrames(OutputFiles& outputs, const std::string& folder,
                             const std::vector<std::string>& names)
    : outputs_(outputs), folder_(folder) {
  if (folder.empty()) return;
  for (const std::string& name : names) names_.push_back(fs::path(name).stem().string() + ".png");
  if (std::set<std::string>(names_.begin(), names_.end()).size() != names.size()) {
    for (std::size_t i = 0; i < names.size(); ++i) names_[i] = names[i] + ".png";
  }
  std::error_code error;
  made_ = fs::create_directory(folder, error);
  if (!fs::is_directory(folder, error)) fail(folder, "no such folder, and it cannot be made");
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string path = entry.path().string();
    if (!readPhotoMetadata(path).is_aligned)
      fail(folder, "--save-aligned: the folder holds " + entry.path().filename().string() +
                       ", which an earlier run has not left there: name another folder");
    previous_.push_back(path);
  }
}

AlignedFrames::~AlignedFrames() {
  if (!made_) return;
  for (const auto& [index, seen] : seen_) outputs_.drop(path(index));
  std::error_code not_empty;
  fs::remove(folder_, not_empty);
}

std::string AlignedFrames::path(int index) const {
  const auto i = static_cast<std::size_t>(index);
  return (fs::path(folder_) / (i < names_.size() ? names_[i] : cv::format("frame_%04d.png", index))).string();
}

std::vector<NamedPath> AlignedFrames::paths() const {
  std::vector<NamedPath> paths;
  for (std::size_t i = 0; i < names_.size(); ++i)
    paths.push_back({"save-aligned", path(static_cast<int>(i))});
  return paths;
}

void AlignedFrames::add(const core::AlignedFrame& frame) {
  seen_[frame.index] = frame.seen;
  if (folder_.empty()) return;
  cv::Mat image = core::withGain(frame);
  if (frame.seen != cv::Rect({}, image.size()) || !frame.opaque.empty()) {
    const cv::Mat opaque = frame.opaque.empty() ? cv::Mat(image.size(), CV_8UC1, 255) : frame.opaque;
    cv::Mat alpha(image.size(), CV_MAKETYPE(image.depth(), 1), cv::Scalar(0));
    alpha(frame.seen).setTo(image.depth() == CV_16U ? 65535 : 255, opaque(frame.seen));
    cv::cvtColor(image, image, cv::COLOR_BGR2BGRA);
    cv::insertChannel(alpha, image, 3);
  }
  PhotoSource source;
  source.is_aligned = true;
  outputs_.addImage(path(frame.index), image, source);
}

cv::Rect AlignedFrames::finish(const core::BracketResult& result) {
  cv::Rect all({}, result.image.size());
  for (const core::FrameStatus& frame : result.frames) {
    const auto seen = seen_.find(frame.index);
    if (seen == seen_.end()) continue;
    if (frame.kind == core::FrameStatus::Kind::kUsed) {
      all &= seen->second;
    } else if (!folder_.empty()) {
      outputs_.drop(path(frame.index));
    }
  }
  return all;
}

void AlignedFrames::commit() {
  made_ = false;
  std::set<std::string> written;
  for (const auto& [index, seen] : seen_) written.insert(path(index));
  std::error_code ignored;
  for (const std::string& old : previous_) {
    if (written.count(old) == 0) fs::remove(old, ignored);
  }
}

}  // namespace all_in_focus
