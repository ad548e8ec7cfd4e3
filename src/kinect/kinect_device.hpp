// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <OpenNI.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "kinect_frame.hpp"

namespace all_in_focus {

/// Keeps OpenNI2 running. It starts with the first attempt to open a camera, and stops when the last of these
/// objects in the process is destroyed.
class OpenNiKeeper {
 public:
  OpenNiKeeper();
  ~OpenNiKeeper();
  OpenNiKeeper(const OpenNiKeeper&) = delete;
  OpenNiKeeper& operator=(const OpenNiKeeper&) = delete;
};

/// Hold one while a device is open or being opened. Drivers such as libfreenect's search for cameras only
/// when OpenNI2 starts, and forget a camera that was closed. So OpenNI2 is restarted when nobody holds a use,
/// and a camera was closed or a USB device was plugged in or out. It is not restarted at every attempt,
/// because each start leaks 0.1 MB.
class OpenNiUse {
 public:
  OpenNiUse();  ///< Throws std::runtime_error.
  ~OpenNiUse();
  OpenNiUse(const OpenNiUse&) = delete;
  OpenNiUse& operator=(const OpenNiUse&) = delete;

  void deviceWasOpened();
};

/// How a recording is played. It has no effect on a camera.
struct KinectPlayback {
  double rate = 1.0;  ///< factor on the recorded pace; 0: as fast as next() is called; no image is lost
  bool repeat = true;
};

/// A depth camera or a recording through OpenNI2. Call all methods of one object from one thread. They throw
/// std::runtime_error with a message of one line.
class KinectDevice {
 public:
  /// device: a URI of OpenNI2, the path of an .oni file, "#n" (the n-th device found, from 1), or "" (the
  /// first). The message of the exception lists the devices that were found.
  KinectDevice(const std::string& device, const KinectPlayback& playback);
  ~KinectDevice();
  KinectDevice(const KinectDevice&) = delete;
  KinectDevice& operator=(const KinectDevice&) = delete;

  const std::string& description() const { return description_; }
  bool isFile() const { return device_.isFile(); }
  /// Device seconds per host second; 0: images have no pace.
  double rate() const { return isFile() ? playback_.rate : 1.0; }

  /// Starts a stream with 640x480 pixels at 30 Hz if the camera offers it, without mirroring, hardware
  /// registration or cropping.
  void start(KinectStream stream);
  void stop(KinectStream stream);
  bool isRunning(KinectStream stream) const { return slot(stream).running; }

  /// The next image of the running streams, oldest first; it is valid until the next call. False if none came
  /// within timeout_ms. A recording loses no image, however slow the caller is.
  bool next(KinectFrame& frame, int timeout_ms);

  bool isUnplugged() const;
  /// Whether a recording will deliver no more images: it does not repeat, or its end is missing.
  bool hasEnded() const;

 private:
  class Events;
  using Clock = std::chrono::steady_clock;
  struct Slot {
    openni::VideoStream stream;
    KinectMode mode;
    bool running = false;
    int last_index = 0;  // of its images; in a recording they count from 1
  };

  Slot& slot(KinectStream stream) { return slots_[indexOf(stream)]; }
  const Slot& slot(KinectStream stream) const { return slots_[indexOf(stream)]; }
  void setPlayback();
  void chooseMode(KinectStream stream);
  void destroy(Slot& slot);
  bool receive(int timeout_ms);
  Clock::time_point dueTime() const;

  const KinectPlayback playback_;
  OpenNiUse use_;
  openni::Device device_;
  std::string description_;
  std::unique_ptr<Events> events_;
  std::array<Slot, 3> slots_;
  openni::VideoFrameRef current_;
  KinectStream current_stream_ = KinectStream::kDepth;

  // Playback of a recording: the current image waits until it is due.
  bool waiting_ = false;
  bool ended_ = false;  // and the player has begun again
  Clock::time_point due_;
  std::uint64_t last_us_ = 0;  // stamp of the image before
  int silent_ms_ = 0;          // time without an image
};

}  // namespace all_in_focus
