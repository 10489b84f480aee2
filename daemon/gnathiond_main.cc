// gnathiond: reads its configuration, serves until SIGTERM, reloads on SIGHUP.
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>

#include "core/log.h"
#include "daemon/server.h"
#include "daemon/system_notify.h"
#include "pipeline/phantom_device.h"
#include "pipeline/version.h"

namespace {

using namespace gnathion;
using daemon::DaemonConfig;

int print_error(const Error& error) {
  fmt::print(stderr, "gnathiond: {}\n", error.line());
  return exit_code(error.code);
}

int check_config(const DaemonConfig& config) {
  const auto faults = daemon::faults_of(config);
  for (const std::string& fault : faults) fmt::print(stderr, "gnathiond: {}\n", fault);
  if (!faults.empty()) return exit_code(ErrorCode::kInput);
  fmt::print("{}: good\n", config.file.empty() ? "defaults" : config.file.string());
  return 0;
}

/// Signals arrive here as bytes, in the main loop, not in the middle of something.
int signal_fd() {
  sigset_t wanted;
  ::sigemptyset(&wanted);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) ::sigaddset(&wanted, signal);
  ::pthread_sigmask(SIG_BLOCK, &wanted, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGCHLD, SIG_DFL);  // inherited as ignored, it would take the jobs' ends away
  ::signal(SIGXFSZ, SIG_IGN);  // a limit on the file's size is told by write()
  return ::signalfd(-1, &wanted, SFD_CLOEXEC);
}

void reload(daemon::Daemon& running, const std::string& file) {
  if (file.empty()) return;
  daemon::notify_reloading();
  const auto config = daemon::read_daemon_config(file);
  if (!config) {
    log(LogLevel::kError, "the configuration stays as it was: " + config.error().line());
  } else {
    for (const std::string& line : running.reload(*config)) log(LogLevel::kWarning, line);
    log(LogLevel::kInfo, "configuration read again");
  }
  daemon::notify_ready();
}

/// Until SIGTERM or SIGINT. The watchdog is fed while every loop goes on, and only then.
void serve(daemon::Daemon& running, const std::string& file, int signals) {
  const double feed_s = daemon::watchdog_interval_s().value_or(2.0) / 2;
  std::string told;
  while (true) {
    pollfd wait{signals, POLLIN, 0};
    ::poll(&wait, 1, static_cast<int>(1000 * std::min(1.0, feed_s)));
    std::string why;
    if (running.well(&why)) {
      daemon::notify_watchdog();
      told.clear();
    } else if (told.empty()) {
      told = why;
      log(LogLevel::kError, why + "; the watchdog is not fed");
    }
    signalfd_siginfo info{};
    if (!(wait.revents & POLLIN) || ::read(signals, &info, sizeof info) != sizeof info) continue;
    if (info.ssi_signo != SIGHUP) return;
    reload(running, file);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "gnathiond: owns instruments, cases and jobs; gnathion and gnathion-viewer are its clients.\n"
      "Research software; it makes no clinical claim.",
      "gnathiond");
  std::string file;
  bool check = false;
  app.add_option("--config", file, "gnathiond.toml (docs/daemon.md); without it the defaults hold");
  app.add_flag("--check-config", check, "read it, say what is wrong with it, and end");
  app.set_version_flag("--version", std::string("gnathiond ") + kVersion);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);
    fmt::print(stderr, "gnathiond: wrong usage: {}: try --help\n", e.what());
    return exit_code(ErrorCode::kUsage);
  }
  const Result<DaemonConfig> config =
      file.empty() ? Result<DaemonConfig>(DaemonConfig{}) : daemon::read_daemon_config(file);
  if (!config) return print_error(config.error());
  if (check) return check_config(*config);

  ::umask(0077);  // files 0600, folders 0700
  const int signals = signal_fd();
  SystemClock clock;
  add_phantom_device();
  auto running = daemon::Daemon::start(*config, clock);
  if (!running) return print_error(running.error());
  daemon::notify_ready();
  serve(**running, file, signals);
  log(LogLevel::kInfo, "going down: a recording is finished first");
  daemon::notify_stopping();
  running->reset();
  return 0;
}
