// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "image_queue.hpp"

#include <boost/make_shared.hpp>
#include <cstdint>
#include <utility>
#include <vector>

#include "transports.hpp"

namespace all_in_focus {
namespace {

class Call : public ros::CallbackInterface {
 public:
  explicit Call(std::function<void()> function) : function_(std::move(function)) {}
  CallResult call() override {
    function_();
    return Success;
  }

 private:
  const std::function<void()> function_;
};

}  // namespace

ImageQueue::ImageQueue(std::size_t size, Acknowledger& monitor, CallbackGuard& guard, int input,
                       Callback process)
    : monitor_(monitor),
      guard_(guard),
      process_(std::move(process)),
      on_image_(guard.input<sensor_msgs::Image>(
          input, [this](const sensor_msgs::ImageConstPtr& image) { push(image); })),
      on_turn_(guard.wrap(monitor.resolved(input), [this] { processOldest(); })),
      waiting_(size) {}

void ImageQueue::subscribe(const std::string& topic) {
  const image_transport::TransportHints hints = chosenTransport(guard_.quick_nh, guard_.private_nh, monitor_);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    open_ = true;
  }
  const std::uint32_t endless = 0;  // push() returns at once, and waiting images are limited here
  subscriber_ = image_transport::ImageTransport(guard_.quick_nh)
                    .subscribe(topic, endless, on_image_, ros::VoidPtr(), hints);
}

void ImageQueue::shutdown() {
  subscriber_.shutdown();
  subscriber_ = {};
  std::lock_guard<std::mutex> lock(mutex_);
  open_ = false;
  waiting_.clear();
}

void ImageQueue::push(const sensor_msgs::ImageConstPtr& image) {
  std::vector<sensor_msgs::ImageConstPtr> dropped;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!open_) return;
    dropped = waiting_.push(image, image->data.size());
  }
  for (const auto& each : dropped)
    monitor_.acknowledge(each->header, Outcome::kDropped, "cannot keep up: oldest waiting image dropped");
  if (dropped.empty()) guard_.queue().addCallback(boost::make_shared<Call>(on_turn_));
}

void ImageQueue::processOldest() {
  sensor_msgs::ImageConstPtr image;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (waiting_.empty()) return;
    image = waiting_.pop();
  }
  process_(image);
}

}  // namespace all_in_focus
