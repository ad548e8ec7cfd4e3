// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "counted_subscription.hpp"

#include <boost/make_shared.hpp>
#include <cstdint>
#include <utility>

#include "transport_choice.hpp"

namespace all_in_focus {

class CountedSubscription::Call : public ros::CallbackInterface {
 public:
  explicit Call(CountedSubscription& owner) : owner_(owner) {}
  CallResult call() override {
    owner_.processOldest();
    return Success;
  }

 private:
  CountedSubscription& owner_;
};

CountedSubscription::CountedSubscription(ros::CallbackQueueInterface& worker, std::size_t size,
                                         NodeMonitor& monitor, Callback process)
    : worker_(worker), size_(size), monitor_(monitor), process_(std::move(process)) {}

CountedSubscription::~CountedSubscription() {
  subscriber_.shutdown();
  worker_.removeByID(reinterpret_cast<std::uint64_t>(this));
}

void CountedSubscription::subscribe(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                    const std::string& topic) {
  const image_transport::TransportHints hints = chosenTransport(nh, private_nh, monitor_);
  const std::uint32_t endless = 0;  // push() never takes long
  subscriber_ =
      image_transport::ImageTransport(nh).subscribe(topic, endless, &CountedSubscription::push, this, hints);
}

void CountedSubscription::shutdown() {
  subscriber_.shutdown();
  subscriber_ = {};
  std::lock_guard<std::mutex> lock(mutex_);
  waiting_.clear();
}

void CountedSubscription::push(const sensor_msgs::ImageConstPtr& image) {
  sensor_msgs::ImageConstPtr dropped;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    waiting_.push_back(image);
    if (waiting_.size() > size_) {
      dropped = waiting_.front();  // its call is for the one that came
      waiting_.pop_front();
    }
  }
  if (dropped) {
    monitor_.consumed(dropped->header, Outcome::kDropped, "cannot keep up: oldest waiting image dropped");
  } else {
    worker_.addCallback(boost::make_shared<Call>(*this), reinterpret_cast<std::uint64_t>(this));
  }
}

void CountedSubscription::processOldest() {
  sensor_msgs::ImageConstPtr image;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (waiting_.empty()) return;
    image = waiting_.front();
    waiting_.pop_front();
  }
  process_(image);
}

}  // namespace all_in_focus
