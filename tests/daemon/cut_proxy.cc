#include "tests/daemon/cut_proxy.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <thread>
#include <vector>

namespace gnathion::testing {
namespace {

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  return address;
}

bool forward(int from, int to) {
  char block[16384];
  const ssize_t n = ::recv(from, block, sizeof block, 0);
  for (ssize_t sent = 0; sent < n;) {
    const ssize_t m = ::send(to, block + sent, static_cast<std::size_t>(n - sent), MSG_NOSIGNAL);
    if (m <= 0) return false;
    sent += m;
  }
  return n > 0;
}

}  // namespace

struct CutProxy::State {
  std::string path, target;
  int listener = -1;
  std::atomic<bool> stopping{false}, cutting{false};
  std::thread thread;
  struct Pair {
    int client, daemon;
  };
  std::vector<Pair> pairs;

  void drop(std::size_t i) {
    ::close(pairs[i].client);
    ::close(pairs[i].daemon);
    pairs.erase(pairs.begin() + static_cast<std::ptrdiff_t>(i));
  }
  void run() {
    while (!stopping) {
      if (cutting.exchange(false))
        while (!pairs.empty()) drop(pairs.size() - 1);
      std::vector<pollfd> waits = {{listener, POLLIN, 0}};
      for (const Pair& p : pairs) {
        waits.push_back({p.client, POLLIN, 0});
        waits.push_back({p.daemon, POLLIN, 0});
      }
      ::poll(waits.data(), waits.size(), 1);
      for (std::size_t i = pairs.size(); i-- > 0;) {
        bool good = true;
        if (waits[1 + 2 * i].revents) good = forward(pairs[i].client, pairs[i].daemon);
        if (good && waits[2 + 2 * i].revents) good = forward(pairs[i].daemon, pairs[i].client);
        if (!good) drop(i);
      }
      if (!waits[0].revents) continue;
      const int client = ::accept(listener, nullptr, nullptr);
      const int daemon = ::socket(AF_UNIX, SOCK_STREAM, 0);
      const sockaddr_un to = address_of(target);
      if (::connect(daemon, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0) {
        pairs.push_back({client, daemon});
      } else {
        ::close(client);
        ::close(daemon);
      }
    }
    while (!pairs.empty()) drop(pairs.size() - 1);
  }
};

CutProxy::CutProxy(const std::string& path, const std::string& target) : state_(std::make_unique<State>()) {
  state_->path = path;
  state_->target = target;
  state_->listener = ::socket(AF_UNIX, SOCK_STREAM, 0);
  const sockaddr_un at = address_of(path);
  ::unlink(path.c_str());
  (void)::bind(state_->listener, reinterpret_cast<const sockaddr*>(&at), sizeof at);
  (void)::listen(state_->listener, 16);
  state_->thread = std::thread([s = state_.get()] { s->run(); });
}
CutProxy::~CutProxy() {
  state_->stopping = true;
  state_->thread.join();
  ::close(state_->listener);
  ::unlink(state_->path.c_str());
}
void CutProxy::cut() {
  state_->cutting = true;
}
std::string CutProxy::path() const {
  return state_->path;
}

}  // namespace gnathion::testing
