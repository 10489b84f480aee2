#include "core/time.h"

#include <chrono>
#include <fstream>
#include <string>

namespace gnathion {
namespace {

std::int64_t steady_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

SystemClock::SystemClock()
    : epoch_of_steady_ns_(std::chrono::duration_cast<std::chrono::nanoseconds>(
                              std::chrono::system_clock::now().time_since_epoch())
                              .count() -
                          steady_ns()) {}

HostTime SystemClock::now() {
  return {epoch_of_steady_ns_ + steady_ns()};
}

Stopwatch::Stopwatch() : start_ns_(steady_ns()) {}
double Stopwatch::seconds() const {
  return static_cast<double>(steady_ns() - start_ns_) * 1e-9;
}
void Stopwatch::restart() {
  start_ns_ = steady_ns();
}

double peak_rss_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024.0;
  return 0.0;
}

}  // namespace gnathion
