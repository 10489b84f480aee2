#include "daemon/igtl/igtl_client.h"

#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>

namespace gnathion::daemon {
namespace {

/// Clients send requests of some bytes; a body larger than this is none.
constexpr std::uint64_t kMaxRequest = 64 << 10;
constexpr int kMaxNonsense = 32;

}  // namespace

IgtlClient::IgtlClient(int socket, std::string name, HostTime now)
    : socket_(socket), name_(std::move(name)), framer_(kMaxRequest), progress_(now) {}

IgtlClient::~IgtlClient() {
  ::close(socket_);
}

void IgtlClient::queue(const std::string& key, IgtlMessage message) {
  const auto [place, added] = waiting_.insert_or_assign(key, std::move(message));
  if (added) order_.push_back(key);
}

bool IgtlClient::send(HostTime now) {
  while (wants_to_send()) {
    if (!current_) {
      const auto next = waiting_.find(order_.front());
      current_ = next->second;
      sent_ = 0;
      waiting_.erase(next);
      order_.pop_front();
    }
    const ssize_t n = ::send(socket_, current_->data() + sent_, current_->size() - sent_, MSG_NOSIGNAL);
    if (n < 0) return errno == EAGAIN || errno == EINTR;
    progress_ = now;
    sent_ += static_cast<std::size_t>(n);
    if (sent_ == current_->size()) current_.reset();
  }
  progress_ = now;
  return true;
}

std::string IgtlClient::receive() {
  char block[4096];
  const ssize_t n = ::recv(socket_, block, sizeof block, 0);
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return {};
  if (n <= 0) return "it has gone";
  framer_.feed({block, static_cast<std::size_t>(n)});
  futile_bytes_ += static_cast<std::uint64_t>(n);
  // The framer tells of noise only once a message comes again: bytes are counted too.
  const bool nonsense = nonsense_ >= kMaxNonsense || futile_bytes_ > 2 * kMaxRequest;
  return nonsense ? "what it sends is no OpenIGTLink" : "";
}

std::optional<igtl::Item> IgtlClient::next() {
  auto item = framer_.next();
  if (item && item->kind == igtl::Item::Kind::kRejected) ++nonsense_;
  if (item && item->kind == igtl::Item::Kind::kMessage) futile_bytes_ = 0;
  return item;
}

double IgtlClient::stalled_s(HostTime now) const {
  return wants_to_send() ? now.seconds_since(progress_) : 0;
}

}  // namespace gnathion::daemon
