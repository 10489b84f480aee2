#include "cli/capture_command.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <csignal>
#include <nlohmann/json.hpp>
#include <set>

#include "acquisition/scanner/scan_devices.h"
#include "acquisition/session.h"
#include "pipeline/capture_setup.h"
#include "pipeline/version.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::atomic<bool> asked_to_end{false};
std::atomic<int> scans_asked{0};

/// SIGINT and SIGTERM end the recording properly; SIGUSR1 asks for a scan; a limit on the file's size is told
/// by write(), not by a signal.
class CaptureSignals {
 public:
  CaptureSignals() {
    struct sigaction action {};
    action.sa_handler = [](int) { asked_to_end = true; };
    ::sigaction(SIGINT, &action, &old_int_);
    ::sigaction(SIGTERM, &action, &old_term_);
    action.sa_handler = [](int) { ++scans_asked; };
    ::sigaction(SIGUSR1, &action, &old_usr1_);
    struct sigaction ignore {};
    ignore.sa_handler = SIG_IGN;
    ::sigaction(SIGXFSZ, &ignore, &old_xfsz_);
  }
  ~CaptureSignals() {
    ::sigaction(SIGINT, &old_int_, nullptr);
    ::sigaction(SIGTERM, &old_term_, nullptr);
    ::sigaction(SIGUSR1, &old_usr1_, nullptr);
    ::sigaction(SIGXFSZ, &old_xfsz_, nullptr);
  }

 private:
  struct sigaction old_int_ {
  }, old_term_{}, old_usr1_{}, old_xfsz_{};
};

struct CaptureOptions {
  std::string devices, out;
  double duration_s = 0;  ///< 0: until a signal
  std::vector<std::string> attach;
};

void say(const std::string& line) {
  fmt::print(stderr, "gnathion: {}\n", line);
}

/// One line for each device that cannot be opened; the others are what is recorded.
std::vector<std::unique_ptr<Device>> open_and_tell(const std::vector<DeviceConfig>& configs, Clock& clock,
                                                   bool quiet) {
  OpenedDevices opened = open_devices(configs, clock);
  for (const std::string& failure : opened.failures) say(failure);
  if (!quiet)
    for (const std::string& warning : opened.warnings) say(warning);
  return std::move(opened.devices);
}

std::uint64_t sum_of(const std::map<std::string, std::uint64_t>& by_reason) {
  std::uint64_t sum = 0;
  for (const auto& [reason, n] : by_reason) sum += n;
  return sum;
}

std::string status_line(const SessionStatus& s) {
  std::string line = fmt::format("{:.1f} s", s.elapsed_s);
  for (const SessionDevice& d : s.devices) {
    const auto counts = s.ledger.find(d.description.stream);
    line += fmt::format(" | {} {}", d.description.stream, name_of(d.health.state));
    if (d.health.rate_hz > 0) line += fmt::format(" {:.1f} Hz", d.health.rate_hz);
    if (const ClockEstimate& c = d.health.clock; c.known)
      line += fmt::format(" jitter {:.2f} ms drift {:+.1f} ppm", c.jitter_ms, c.drift_ppm);
    if (counts == s.ledger.end()) continue;
    line += fmt::format(" {}", counts->second.received);
    const std::uint64_t lost = counts->second.missing + sum_of(counts->second.rejected);
    if (lost > 0) line += fmt::format(" -{}", lost);
  }
  for (const RigCounts& rig : s.rigs)
    line += fmt::format(" | {} {} sets, {} lone", rig.name, rig.sets, rig.lone);
  const double fill = static_cast<double>(s.queue_bytes) / static_cast<double>(s.queue_capacity_bytes);
  return line + fmt::format(" | queue {:.0f} % | {:.1f} MiB/s", 100 * fill, s.disk_mib_s);
}

/// Cut to the terminal's width: a line that wraps cannot be drawn over.
std::string fit_to_terminal(std::string line) {
  winsize size{};
  if (::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 && line.size() >= size.ws_col)
    line.resize(size.ws_col - 1u);
  return line;
}

/// Devices of a session that can do more than deliver. They live as long as the session.
template <class T>
std::vector<T*> those_that(const std::vector<std::unique_ptr<Device>>& devices) {
  std::vector<T*> found;
  for (const auto& device : devices)
    if (auto* able = dynamic_cast<T*>(device.get())) found.push_back(able);
  return found;
}

/// Each SIGUSR1 asks every scanner for one scan.
void pass_on_requests(const std::vector<ScanOnRequest*>& scanners) {
  for (int n = scans_asked.exchange(0); n > 0; --n) {
    if (scanners.empty()) say("no instrument here scans on request");
    for (ScanOnRequest* scanner : scanners) scanner->request_scan();
  }
}

/// Waits for the end, showing on a terminal how it goes and telling each device that fails.
void watch(Session& session, const std::vector<ScanOnRequest*>& scanners, double duration_s, bool show) {
  std::set<std::string> told;
  while (true) {
    pass_on_requests(scanners);
    const SessionStatus status = session.status();
    for (const SessionDevice& d : status.devices)
      if (d.health.state == DeviceState::kFailed && told.insert(d.description.stream).second)
        say(fmt::format("{}{}", show ? "\r\033[K" : "", d.health.message));
    if (show) fmt::print(stderr, "\r\033[K{}", fit_to_terminal(status_line(status)));
    const double left_s = duration_s > 0 ? duration_s - status.elapsed_s : 1.0;
    if (asked_to_end || left_s <= 0 || session.wait_for(std::min(0.1, left_s))) break;
  }
  if (show) fmt::print(stderr, "\r\033[K");
}

json status_json(const SessionStatus& s, const std::string& out) {
  json streams = json::object();
  for (const auto& [name, c] : s.ledger)
    streams[name] = {{"received", c.received}, {"missing", c.missing}, {"rejected", c.rejected}};
  json devices = json::array();
  for (const SessionDevice& d : s.devices) {
    json device = {{"stream", d.description.stream},
                   {"kind", d.description.kind},
                   {"state", name_of(d.health.state)},
                   {"message", d.health.message},
                   {"reconnects", d.health.reconnects}};
    if (const ClockEstimate& c = d.health.clock; c.known)
      device["clock"] = {{"jitter_ms", c.jitter_ms},
                         {"drift_ppm", c.drift_ppm},
                         {"outliers", c.outliers},
                         {"restarts", c.restarts}};
    devices.push_back(std::move(device));
  }
  json rigs = json::object();
  for (const RigCounts& rig : s.rigs) rigs[rig.name] = {{"sets", rig.sets}, {"lone", rig.lone}};
  return {{"out", out},
          {"rigs", rigs},
          {"elapsed_s", s.elapsed_s},
          {"bytes", s.file_bytes},
          {"streams", streams},
          {"devices", devices},
          {"queue_peak_bytes", s.queue_peak_bytes},
          {"longest_sync_s", s.longest_sync_s}};
}

std::string status_text(const SessionStatus& s, const std::string& out) {
  std::string text = fmt::format("{:.1f} s, {:.1f} MiB in {}\n", s.elapsed_s,
                                 static_cast<double>(s.file_bytes) / 1048576.0, out);
  for (const auto& [name, c] : s.ledger) {
    text += fmt::format("{:<20} {:>9} received {:>6} missing {:>6} rejected\n", name, c.received, c.missing,
                        sum_of(c.rejected));
    for (const auto& [reason, n] : c.rejected) text += fmt::format("    rejected: {} × {}\n", n, reason);
  }
  for (const RigCounts& rig : s.rigs)
    text +=
        fmt::format("rig {:<16} {:>9} sets of one instant, {} lone frames\n", rig.name, rig.sets, rig.lone);
  return text;
}

Result<CommandOutput> capture(const CaptureOptions& o, const CommonOptions& common) {
  std::vector<std::string> inputs = o.attach;
  inputs.push_back(o.devices);
  GNATHION_CHECK_OK(may_write(o.out, common, inputs));
  GNATHION_TRY(CaptureSetup setup, read_capture_setup(o.devices));
  SessionOptions options;
  options.rigs = std::move(setup.rigs);
  options.attachments = std::move(setup.attachments);
  options.software_version = kVersion;
  for (const std::string& file : o.attach) GNATHION_CHECK_OK(attach_file(file, options.attachments));

  const CaptureSignals signals;
  SystemClock clock;
  std::vector<std::unique_ptr<Device>> devices = open_and_tell(setup.configs, clock, common.quiet);
  if (devices.empty()) return bad_input("cannot record", o.devices, "none of its devices could be opened");
  const auto scanners = those_that<ScanOnRequest>(devices);
  const auto remembering = those_that<RemembersScans>(devices);
  GNATHION_TRY(const auto session, Session::start(o.out, std::move(devices), std::move(options), clock));
  if (!scanners.empty() && !common.quiet) say(fmt::format("kill -USR1 {} asks for a face scan", ::getpid()));
  watch(*session, scanners, o.duration_s, !common.quiet && ::isatty(STDERR_FILENO));
  if (const Status finished = session->finish(); !finished) {
    for (RemembersScans* device : remembering) device->recording_failed();
    return tl::unexpected<Error>(finished.error());
  }
  const SessionStatus status = session->status();
  const bool all_failed = std::all_of(status.devices.begin(), status.devices.end(),
                                      [](const auto& d) { return d.health.state == DeviceState::kFailed; });
  if (all_failed)
    return fail(ErrorCode::kInternal, "recording ended", o.out,
                "every device failed; what came before is in the file");
  return CommandOutput{
      status_text(status, o.out),
      status_json(status, o.out).dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
}

}  // namespace

void add_capture(CLI::App& recording, ChosenCommand& chosen) {
  auto o = std::make_shared<CaptureOptions>();
  CLI::App* command = recording.add_subcommand(
      "capture", "record from live instruments until Ctrl-C or --duration-s; SIGUSR1 asks for a face scan");
  command->add_option("--devices", o->devices, "which instruments, and how they are set (devices.toml)")
      ->required();
  command
      ->add_option("--out", o->out, "recording (.mcap); it grows in place, so that a crash leaves it there")
      ->required();
  command->add_option("--duration-s", o->duration_s, "end after so many seconds")->check(CLI::PositiveNumber);
  command->add_option("--attach", o->attach, "keep these files in the recording too (rig, bow, calibration)");
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress&) -> Result<CommandOutput> {
    return capture(*o, common);
  });
}

}  // namespace gnathion
