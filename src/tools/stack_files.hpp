// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <vector>

#include "photo_metadata.hpp"

namespace all_in_focus {

/// The pictures in a stack folder, sorted out: one rule for all programs.
struct StackFiles {
  /// One frame.
  struct Source {
    std::string path;  ///< of its file
    int page = 0;      ///< of a TIFF
  };

  std::vector<std::string> frames;  ///< names in the order in which the camera numbered them; "a.tif, page 2"
  std::vector<Source> sources;      ///< of the frames
  std::vector<std::string> left_out;  ///< names of pictures that are no frames
  std::vector<std::string> notes;  ///< a line for people about each oddity: what was left out, what disagrees
  Orientation orientation = 1;     ///< of most frames; a camera that looks down tells others at random
};

/// Looks at the files of a folder, or at one TIFF file of several pages, without their pixels.
///
/// Each page of a TIFF is a frame. Of a camera raw file and a picture of the same shot one counts: the raw
/// file if all pictures have one.
///
/// Frames are all pictures but: results of this package, pictures of another size than most, a picture that
/// was made long after all others, and files that cannot be read as pictures. Hidden files do not count.
/// Order: that of natural_order.hpp; the time of exposure in EXIF decides between equal names.
///
/// only: names of frames to look at; empty: all. plain: for a program that reads plainEndings() only. Throws
/// FileError where the folder cannot be read or holds no frame.
StackFiles listStack(const std::string& path, const std::set<std::string>& only = {}, bool plain = false);

/// Whether it is a folder, or a TIFF file of several pages.
bool holdsPictures(const std::string& path);

/// Whether a file of this name may be a picture, as a camera writes it.
bool isPictureName(const std::string& name);

}  // namespace all_in_focus
