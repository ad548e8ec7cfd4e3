// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "transport_choice.hpp"

#include <image_transport/image_transport.h>

#include <algorithm>
#include <string>
#include <vector>

namespace all_in_focus {

image_transport::TransportHints chosenTransport(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                                NodeMonitor& monitor) {
  const std::string raw = "raw", package = "image_transport/";
  const std::string wanted = private_nh.param("image_transport", raw);
  if (wanted != raw) {
    const std::vector<std::string> installed = image_transport::ImageTransport(nh).getLoadableTransports();
    if (std::find(installed.begin(), installed.end(), package + wanted) == installed.end()) {
      std::string names;
      for (const std::string& name : installed) names += " " + name.substr(package.size());
      monitor.error("~image_transport: '" + wanted + "' is not installed here, only" + names + ": using raw");
      private_nh.setParam("image_transport", raw);
    }
  }
  return {raw, ros::TransportHints(), private_nh};
}

}  // namespace all_in_focus
