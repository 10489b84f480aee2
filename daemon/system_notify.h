// What systemd is told: sd_notify(3). Without systemd nothing happens.
#pragma once

#include <optional>
#include <string>

namespace gnathion::daemon {

void notify_ready();
void notify_stopping();
void notify_reloading();
void notify_watchdog();
void notify_status(const std::string& line);
/// Recovering a long recording takes its time: ten minutes more until READY.
void extend_start_timeout();
/// Seconds within which the watchdog wants to be fed; nothing: there is none.
std::optional<double> watchdog_interval_s();

}  // namespace gnathion::daemon
