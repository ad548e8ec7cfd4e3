// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/bracket.hpp"
#include "output_files.hpp"

namespace all_in_focus {

/// Frames as they are fused: in the geometry and exposure of the reference. Writes them into a folder, and
/// knows which part of the picture all of them show.
class AlignedFrames {
 public:
  /// folder: "" = they are not written. names: of the frames' files; empty: of a video. Throws FileError
  /// where the folder cannot be made, or holds anything but such frames, which commit() removes.
  AlignedFrames(OutputFiles& outputs, const std::string& folder, const std::vector<std::string>& names);
  ~AlignedFrames();  ///< removes a folder that was made in vain
  AlignedFrames(const AlignedFrames&) = delete;
  AlignedFrames& operator=(const AlignedFrames&) = delete;

  /// Where the frames will lie.
  std::vector<NamedPath> paths() const;

  /// PNG; where a frame has seen nothing, alpha is 0. The last one of an index counts.
  void add(const core::AlignedFrame& frame);

  /// Drops frames that were not used in the end. Returns what all the others show.
  cv::Rect finish(const core::BracketResult& result);

  /// After those of OutputFiles.
  void commit();

 private:
  std::string path(int index) const;

  OutputFiles& outputs_;
  const std::string folder_;
  std::vector<std::string> names_;     // of the files in the folder; empty: numbered
  std::vector<std::string> previous_;  // paths of an earlier run's
  bool made_ = false;                  // the folder, by this object
  std::map<int, cv::Rect> seen_;       // by index
};

}  // namespace all_in_focus
