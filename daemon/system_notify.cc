#include "daemon/system_notify.h"

#include <fmt/format.h>
#include <systemd/sd-daemon.h>
#include <time.h>

namespace gnathion::daemon {

void notify_ready() {
  ::sd_notify(0, "READY=1");
}
void notify_stopping() {
  ::sd_notify(0, "STOPPING=1\nEXTEND_TIMEOUT_USEC=60000000");
}
void notify_reloading() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  const long long usec = now.tv_sec * 1'000'000LL + now.tv_nsec / 1000;
  ::sd_notify(0, fmt::format("RELOADING=1\nMONOTONIC_USEC={}", usec).c_str());
}
void notify_watchdog() {
  ::sd_notify(0, "WATCHDOG=1");
}
void notify_status(const std::string& line) {
  ::sd_notify(0, ("STATUS=" + line).c_str());
}
void extend_start_timeout() {
  ::sd_notify(0, "EXTEND_TIMEOUT_USEC=600000000");
}
std::optional<double> watchdog_interval_s() {
  std::uint64_t usec = 0;
  if (::sd_watchdog_enabled(0, &usec) <= 0) return std::nullopt;
  return 1e-6 * static_cast<double>(usec);
}

}  // namespace gnathion::daemon
