// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace all_in_focus {

/// Output files that appear all together or not at all. Each is written under a temporary name in its folder;
/// commit() gives them their names. After an error in it every file is as it was before. SIGINT, SIGTERM and
/// SIGHUP remove the temporary files before they end the program; during commit() they wait for its end.
///
/// Throws std::invalid_argument that names the file. One object at a time.
class OutputFiles {
 public:
  OutputFiles();
  ~OutputFiles();  ///< removes what was not committed
  OutputFiles(const OutputFiles&) = delete;
  OutputFiles& operator=(const OutputFiles&) = delete;

  void addImage(const std::string& path, const cv::Mat& image);  ///< see encodeImage()
  void addText(const std::string& path, const std::string& text);
  void commit();

 private:
  struct File {
    std::string path, temporary;
    std::string previous;  ///< where commit() keeps what had the name before; "" if nothing had
  };

  void requireFree(const std::string& path) const;
  void write(const std::string& path, const std::string& data);
  std::vector<File> files_;
};

}  // namespace all_in_focus
