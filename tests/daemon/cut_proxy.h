// Stands between a client and the daemon's socket and cuts the connection when told to: as a cable does.
#pragma once

#include <memory>
#include <string>

namespace gnathion::testing {

class CutProxy {
 public:
  /// Listens on `path`, forwards to `target`.
  CutProxy(const std::string& path, const std::string& target);
  ~CutProxy();
  /// Closes every connection at once, in the middle of whatever they carry; new ones are taken.
  void cut();
  std::string path() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace gnathion::testing
