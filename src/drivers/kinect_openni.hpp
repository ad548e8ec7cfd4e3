// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <OpenNI.h>

#include <memory>
#include <string>

namespace all_in_focus {

/// OpenNI2 is initialised while somebody in the process has a device open or tries to. Drivers such as
/// libfreenect's look for cameras at that moment only, so that every new attempt must begin with it.
class OpenNi {
 public:
  /// Throws std::runtime_error.
  static std::shared_ptr<OpenNi> get();
  ~OpenNi();

 private:
  OpenNi();
};

/// Why the last call failed, in OpenNI2's own words.
std::string openNiReason();

std::string describe(const openni::DeviceInfo& info);  ///< "URI" (name, vendor)

/// device: see KinectDevice. Throws std::runtime_error with a list of what was found.
void openDevice(const std::string& device, openni::Device& opened);

}  // namespace all_in_focus
