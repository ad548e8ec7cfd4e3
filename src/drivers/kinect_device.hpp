// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <OpenNI.h>

#include <array>
#include <memory>
#include <string>

#include "kinect_frame.hpp"

namespace all_in_focus {

/// How a recording is played; of no effect on a camera.
struct KinectPlayback {
  double rate = 1.0;  ///< times the recorded pace; 0: as fast as the images are taken, without loss
  bool repeat = true;
  bool single_step = false;  ///< advance only in next()
  bool manual() const { return single_step || rate <= 0; }
};

/// A depth camera or a recording through OpenNI2. All methods of one object belong to one thread. They throw
/// std::runtime_error with one line for people.
class KinectDevice {
 public:
  /// device: an URI as OpenNI2 knows it, the name of an .oni file, "#n" (the n-th that is found, from 1), or
  /// "" (the first). Throws with a list of what was found.
  KinectDevice(const std::string& device, const KinectPlayback& playback);
  ~KinectDevice();
  KinectDevice(const KinectDevice&) = delete;
  KinectDevice& operator=(const KinectDevice&) = delete;

  const std::string& description() const { return description_; }
  bool isFile() const { return device_.isFile(); }

  /// Starts a stream: 640x480 at 30 Hz where the camera offers it, unmirrored, not registered by the
  /// hardware, uncropped.
  void start(KinectStream stream);
  void stop(KinectStream stream);
  bool isRunning(KinectStream stream) const { return slot(stream).running; }
  const KinectMode& mode(KinectStream stream) const { return slot(stream).mode; }

  /// The next image of the running streams, oldest first; it is valid until the next call. False after
  /// timeout_ms without one.
  bool next(KinectFrame& frame, int timeout_ms);

  bool isUnplugged() const;
  bool hasEnded() const;  ///< a recording that does not repeat: no more images will come

 private:
  class OpenNi;
  class Events;
  struct Slot {
    openni::VideoStream stream;
    KinectMode mode;
    bool running = false;
  };

  Slot& slot(KinectStream stream) { return slots_[static_cast<std::size_t>(stream)]; }
  const Slot& slot(KinectStream stream) const { return slots_[static_cast<std::size_t>(stream)]; }
  void open(const std::string& device);
  void setPlayback();
  void chooseMode(KinectStream stream);

  const KinectPlayback playback_;
  std::shared_ptr<OpenNi> openni_;
  openni::Device device_;
  std::string description_;
  std::unique_ptr<Events> events_;
  std::array<Slot, 3> slots_;
  openni::VideoFrameRef current_;
};

}  // namespace all_in_focus
