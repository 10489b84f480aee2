// How the client library speaks gRPC. For client/*.cc alone.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <functional>
#include <memory>
#include <thread>

#include "client/daemon_client.h"

namespace gnathion::client {

Error error_of(const grpc::Status& status, const std::string& what);
Status status_of(const grpc::Status& status, const std::string& what);

/// A stream of messages of one kind, read by a thread of its own.
template <class Message>
class StreamSubscription : public Subscription {
 public:
  using Reader = std::unique_ptr<grpc::ClientReader<Message>>;
  StreamSubscription(std::string what, std::function<Reader(grpc::ClientContext*)> open,
                     std::function<void(const Message&)> take, Ended ended)
      : what_(std::move(what)), take_(std::move(take)), ended_(std::move(ended)) {
    thread_ = std::thread([this, open = std::move(open)] { run(open); });
  }
  ~StreamSubscription() override {
    closing_ = true;
    context_.TryCancel();
    thread_.join();
  }

 private:
  void run(const std::function<Reader(grpc::ClientContext*)>& open) {
    const Reader reader = open(&context_);
    Message message;
    while (reader->Read(&message) && !closing_) take_(message);
    if (closing_) context_.TryCancel();
    const grpc::Status status = reader->Finish();
    if (!closing_ && ended_) ended_(status_of(status, what_));
  }
  const std::string what_;
  const std::function<void(const Message&)> take_;
  const Ended ended_;
  grpc::ClientContext context_;
  std::atomic<bool> closing_{false};
  std::thread thread_;
};

}  // namespace gnathion::client
