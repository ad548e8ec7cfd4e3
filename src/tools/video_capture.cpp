// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// A library of its own, which StackReader loads for a video: OpenCV's reader brings a hundred libraries with
// it, and to load them takes as long as to fuse a small stack.

#include <opencv2/videoio.hpp>

extern "C" cv::VideoCapture* allInFocusVideoCapture() {
  return new cv::VideoCapture;
}
