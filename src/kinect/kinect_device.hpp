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
#include "kinect_openni.hpp"

namespace all_in_focus {

/// How a recording is played; of no effect on a camera.
struct KinectPlayback {
  double rate = 1.0;  ///< times the recorded pace; 0: as fast as the images are taken, without loss
  bool repeat = true;
  bool single_step = false;  ///< without any pace, whatever the rate
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
  /// Device seconds in a host second; 0: images have no pace.
  double rate() const { return !isFile() ? 1.0 : playback_.single_step ? 0.0 : playback_.rate; }

  /// Starts a stream: 640x480 at 30 Hz where the camera offers it, unmirrored, not registered by the
  /// hardware, uncropped.
  void start(KinectStream stream);
  void stop(KinectStream stream);
  bool isRunning(KinectStream stream) const { return slot(stream).running; }

  /// The next image of the running streams, oldest first; it is valid until the next call. False after
  /// timeout_ms without one. Of a recording none is lost, however slow the caller is.
  bool next(KinectFrame& frame, int timeout_ms);

  bool isUnplugged() const;
  /// A recording of which no more images will come: it does not repeat, or was cut short and lacks its end.
  bool hasEnded() const;

 private:
  class Events;
  using Clock = std::chrono::steady_clock;
  struct Slot {
    openni::VideoStream stream;
    KinectMode mode;
    bool running = false;
  };

  Slot& slot(KinectStream stream) { return slots_[indexOf(stream)]; }
  const Slot& slot(KinectStream stream) const { return slots_[indexOf(stream)]; }
  void setPlayback();
  void chooseMode(KinectStream stream);
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

  // Of a recording: an image waits for its time.
  bool waiting_ = false;
  Clock::time_point due_;
  std::uint64_t last_us_ = 0;  // of the image before
  int silent_ms_ = 0;          // waited for an image since the last
};

}  // namespace all_in_focus
