// Who wants to hear of a change. GUI thread only.
#pragma once

#include <functional>
#include <utility>
#include <vector>

namespace gnathion {

/// Listeners live as long as the thing they listen to: panels and views are owned by the same window.
template <class... Args>
class Listeners {
 public:
  void add(std::function<void(Args...)> listener) { listeners_.push_back(std::move(listener)); }
  void operator()(Args... args) const {
    for (const auto& listener : listeners_) listener(args...);
  }

 private:
  std::vector<std::function<void(Args...)>> listeners_;
};

}  // namespace gnathion
