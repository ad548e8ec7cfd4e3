// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <OpenNI.h>

#include <string>

namespace all_in_focus {

/// OpenNI2 runs from the first attempt to open a camera until the last of these objects of the process ends.
class OpenNiKeeper {
 public:
  OpenNiKeeper();
  ~OpenNiKeeper();
  OpenNiKeeper(const OpenNiKeeper&) = delete;
  OpenNiKeeper& operator=(const OpenNiKeeper&) = delete;
};

/// Held by whoever opens, or has open, a device. Drivers such as libfreenect's look for cameras when OpenNI2
/// starts only, and forget those that were closed. So it is started afresh when nobody holds it, and a camera
/// was closed or something was plugged in or out. Not with every attempt: each start costs 0.1 MB for ever.
class OpenNiUse {
 public:
  OpenNiUse();  ///< Throws std::runtime_error.
  ~OpenNiUse();
  OpenNiUse(const OpenNiUse&) = delete;
  OpenNiUse& operator=(const OpenNiUse&) = delete;

  void deviceWasOpened();
};

/// Why the last call failed, in OpenNI2's own words.
std::string openNiReason();

std::string describe(const openni::DeviceInfo& info);  ///< "URI" (name, vendor)

/// device: see KinectDevice. Throws std::runtime_error with a list of what was found.
void openDevice(const std::string& device, openni::Device& opened);

}  // namespace all_in_focus
