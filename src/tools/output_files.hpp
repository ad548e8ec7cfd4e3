// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "image_files.hpp"
#include "photo_metadata.hpp"

namespace all_in_focus {

/// A file or folder as the user named it, and the option that named it.
struct NamedPath {
  std::string option, path;
};

/// Throws FileError where an output cannot be written, is one of the inputs, or is the same as another
/// output. The same is what has one device and inode, whatever its name. Of a folder that is read, pictures
/// and YAML files are inputs; earlier results of this package in it are not.
void requireSeparate(const std::vector<NamedPath>& inputs, const std::vector<NamedPath>& outputs);

/// Output files that appear all together or not at all. Each is written under a temporary name in its folder;
/// commit() gives them their names. After an error in it every file is as it was before. SIGINT, SIGTERM and
/// SIGHUP remove the temporary files before they end the program; during commit() they wait for its end.
///
/// A symbolic link stays, and the file that it names is replaced. What is no regular file (a FIFO,
/// /dev/stdout) is written to as it is, first of all in commit(). Pictures are marked as results, see
/// markAsResult(); where the format has no place for the mark, a file markBeside() it is written, too.
///
/// Throws FileError that names the file. One object at a time.
class OutputFiles {
 public:
  OutputFiles();
  ~OutputFiles();  ///< removes what was not committed
  OutputFiles(const OutputFiles&) = delete;
  OutputFiles& operator=(const OutputFiles&) = delete;

  /// See encodeImage() and markAsResult(). Whatever is added for a path once more replaces what was.
  void addImage(const std::string& path, const cv::Mat& image, const PhotoSource& source = {},
                int quality = kDefaultQuality);
  void addText(const std::string& path, const std::string& text);
  /// Takes back what was added for this path.
  void drop(const std::string& path);
  void commit();

 private:
  struct File {
    std::string path, temporary;
    std::string previous;  ///< where commit() keeps what had the name before; "" if nothing had
  };
  struct Stream {
    std::string path, data;
  };

  void add(const std::string& path, const std::string& data);
  void writeStreams() const;
  std::vector<File> files_;
  std::vector<Stream> streams_;
};

/// Removes what OutputFiles has not committed, for a process that must end at once.
void removeTemporaryFiles();

}  // namespace all_in_focus
