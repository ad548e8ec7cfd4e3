// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "callback_guard.hpp"

#include <image_transport/image_transport.h>

#include <boost/make_shared.hpp>
#include <deque>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <utility>

#include "image_limit.hpp"
#include "parameters.hpp"

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

struct WaitingImages {
  std::mutex mutex;
  std::deque<sensor_msgs::ImageConstPtr> images;  // oldest first; the queue has a call for each, at least
};

}  // namespace

CallbackGuard::Thread::Thread(const ros::NodeHandle& nodelet_nh, const ros::NodeHandle& nodelet_private_nh)
    : nh(nodelet_nh), private_nh(nodelet_private_nh) {
  nh.setCallbackQueue(&queue);
  private_nh.setCallbackQueue(&queue);
}

CallbackGuard::CallbackGuard(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, NodeStatus& status)
    : slow(nh, private_nh), quick(nh, private_nh), status_(status) {}

void CallbackGuard::start() {
  slow.spinner.start();
  quick.spinner.start();
}

void CallbackGuard::stop() {
  quick.spinner.stop();
  if (on_stop) on_stop();
  slow.spinner.stop();
}

void CallbackGuard::post(const std::function<void()>& function) {
  slow.queue.addCallback(boost::make_shared<Call>(wrap(function)));
}

image_transport::Subscriber CallbackGuard::receiveImages(int input, const ImageCallback& receive,
                                                         bool lossless) {
  const std::string raw = "raw";
  std::string wanted = raw;
  readParameter(quick.private_nh, "image_transport", wanted, status_);
  const auto subscribe = [&] {
    const image_transport::TransportHints hints(raw, ros::TransportHints(), quick.private_nh);
    return image_transport::ImageTransport(quick.nh).subscribe(status_.topic(input), kArrivingImages,
                                                               checked<sensor_msgs::Image>(input, receive),
                                                               ros::VoidPtr(), hints);
  };
  image_transport::Subscriber subscriber;
  try {
    if (lossless && wanted != raw && wanted != "compressedDepth")
      throw std::invalid_argument('\'' + wanted + "' may change depths, only raw and compressedDepth do not");
    subscriber = subscribe();
  } catch (const std::exception& e) {
    status_.error(std::string("~image_transport: using raw: ") + e.what());
    quick.private_nh.setParam("image_transport", raw);
    subscriber = subscribe();
  }
  status_.setOnWire(input, subscriber.getTopic());
  return subscriber;
}

image_transport::Subscriber CallbackGuard::subscribeToDepth(int input, std::size_t most,
                                                            const ImageCallback& process) {
  // The subscription owns what waits: nothing of it is processed after it ends.
  const auto waiting = std::make_shared<WaitingImages>();
  const auto turn = [this, waits = std::weak_ptr<WaitingImages>(waiting), process] {
    const auto waiting = waits.lock();
    if (!waiting) return;
    sensor_msgs::ImageConstPtr oldest;
    {
      std::lock_guard<std::mutex> lock(waiting->mutex);
      if (waiting->images.empty()) return;
      oldest = std::move(waiting->images.front());
      waiting->images.pop_front();
    }
    try {
      process(oldest);
    } catch (const std::exception& e) {
      status_.acknowledge(oldest->header, Outcome::kInvalid, e.what());
    }
  };
  const auto receive = [this, waiting, most, turn](const sensor_msgs::ImageConstPtr& image) {
    std::lock_guard<std::mutex> lock(waiting->mutex);
    const std::size_t before = waiting->images.size();
    waiting->images.push_back(image);
    for (const std::size_t limit = imageLimit(most, *image, kMaxWaitingBytes / 16);
         waiting->images.size() > limit; waiting->images.pop_front()) {
      status_.acknowledge(waiting->images.front()->header, Outcome::kDropped,
                          "cannot keep up: oldest waiting image dropped");
    }
    // An image that displaces another one takes over its call.
    if (waiting->images.size() > before) post(turn);
  };
  return receiveImages(input, receive, /*lossless=*/true);
}

}  // namespace all_in_focus
