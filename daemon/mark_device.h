// Marks that clients set, as a device of the recording.
#pragma once

#include <memory>

#include "acquisition/device.h"
#include "core/bounded_queue.h"

namespace gnathion::daemon {

class MarkDevice : public Device {
 public:
  static constexpr const char* kStream = "marks";
  using Queue = BoundedQueue<Sample>;
  explicit MarkDevice(std::shared_ptr<Queue> queue) : queue_(std::move(queue)) {}
  ~MarkDevice() override { stop(); }
  Result<std::optional<Sample>> next() override { return queue_->pop(); }
  DeviceDescription description() const override {
    DeviceDescription d;
    d.kind = "marks";
    d.stream = kStream;
    d.model = "marks of clients";
    return d;
  }
  DeviceHealth health() const override {
    DeviceHealth h;
    h.state = DeviceState::kRunning;
    return h;
  }
  void stop() override { queue_->close(); }

 private:
  const std::shared_ptr<Queue> queue_;
};

}  // namespace gnathion::daemon
