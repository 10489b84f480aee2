// live: what the instruments say now, on a terminal, also over ssh: plain text and a few escape sequences.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <csignal>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "cli/daemon_commands.h"

namespace gnathion {
namespace {

using client::DaemonClient;
using nlohmann::json;

std::atomic<bool> asked_to_end{false};

/// What the streams have brought last.
struct LiveView {
  std::mutex mutex;
  std::condition_variable changed;
  std::optional<client::Session> session;
  std::optional<client::LedgerUpdate> ledger;
  std::optional<client::PoseUpdate> poses;
  std::uint64_t poses_seen = 0, poses_missed = 0;
  std::string last_event;
  std::optional<Status> ended;
};

std::string pose_line(const client::Pose& p) {
  if (!p.valid) return fmt::format("{:<12} --  {}", p.body, p.reason);
  const Vector3& t = p.reference_from_body.translation_mm;
  const double degrees = p.reference_from_body.angle_rad() * 180.0 / std::numbers::pi;
  std::string line = fmt::format("{:<12} {:>9.3f} {:>9.3f} {:>9.3f} mm {:>8.3f}°  in {}", p.body, t.x(),
                                 t.y(), t.z(), degrees, p.reference);
  if (p.tags > 0) line += fmt::format(", {} tags", p.tags);
  if (p.rms_px > 0) line += fmt::format(", {:.2f} px", p.rms_px);
  if (!p.mi.empty()) line += fmt::format(", MI: {}", p.mi);
  return line;
}

std::vector<std::string> lines_of(const LiveView& v) {
  std::vector<std::string> lines;
  if (v.session) {
    lines.push_back(fmt::format("{} {} {} {:.1f} s {:.1f} MiB, {} marks", client::name_of(v.session->state),
                                v.session->case_id, v.session->recording, v.session->elapsed_s,
                                static_cast<double>(v.session->file_bytes) / 1048576.0, v.session->marks));
    if (!v.session->message.empty()) lines.push_back(v.session->message);
    for (const std::string& line : v.session->devices_missing) lines.push_back("missing: " + line);
  }
  if (v.ledger) {
    for (const auto& d : v.ledger->devices)
      lines.push_back(fmt::format("{:<16} {:<10} {}", d.stream, d.state, d.message));
    for (const auto& s : v.ledger->streams)
      lines.push_back(fmt::format("{:<16} {:>6.1f} Hz {:>9} received {:>6} missing {:>6} rejected {}",
                                  s.stream, s.rate_hz, s.received, s.missing, s.rejected, s.last_reason));
    lines.push_back(fmt::format(
        "poses {:.0f} Hz, {:.2f} ms behind the camera, {} frames left out | queue {:.0f} % | "
        "disk {:.1f} MiB/s | this view missed {} of {}",
        v.ledger->pose_rate_hz, v.ledger->pose_latency_ms, v.ledger->pose_frames_skipped,
        100 * v.ledger->queue_fill, v.ledger->disk_mib_s, v.poses_missed, v.poses_seen + v.poses_missed));
  }
  if (v.poses)
    for (const client::Pose& p : v.poses->poses) lines.push_back(pose_line(p));
  if (!v.last_event.empty()) lines.push_back("last: " + v.last_event);
  return lines;
}

json json_of(const LiveView& v) {
  json j = json::object();
  if (v.session) j["session"] = {{"state", client::name_of(v.session->state)}, {"case", v.session->case_id}};
  if (v.ledger) {
    json streams = json::object();
    for (const auto& s : v.ledger->streams)
      streams[s.stream] = {
          {"rate_hz", s.rate_hz}, {"received", s.received}, {"missing", s.missing}, {"rejected", s.rejected}};
    j["streams"] = streams;
    j["poses"] = v.ledger->poses;
    j["pose_latency_ms"] = v.ledger->pose_latency_ms;
  }
  json poses = json::array();
  if (v.poses)
    for (const client::Pose& p : v.poses->poses) {
      const Vector3& t = p.reference_from_body.translation_mm;
      poses.push_back({{"body", p.body},
                       {"reference", p.reference},
                       {"valid", p.valid},
                       {"reason", p.reason},
                       {"translation_mm", {t.x(), t.y(), t.z()}},
                       {"tags", p.tags}});
    }
  j["pose"] = poses;
  return j;
}

/// Redraws in place: up over what was drawn before, each line cleared to its end.
class Screen {
 public:
  void draw(const std::vector<std::string>& lines) {
    std::string out;
    if (drawn_ > 0) out += fmt::format("\033[{}A", drawn_);
    for (const std::string& line : lines) out += "\r\033[K" + line + "\n";
    for (std::size_t i = lines.size(); i < drawn_; ++i) out += "\r\033[K\n";
    drawn_ = std::max(drawn_, lines.size());
    std::fputs(out.c_str(), stderr);
    std::fflush(stderr);
  }

 private:
  std::size_t drawn_ = 0;
};

/// Until Ctrl-C, the time is over, or the daemon goes. The last view is the command's result.
Result<CommandOutput> watch(DaemonClient& daemon, double duration_s) {
  LiveView view;
  const auto set = [&view](auto change) {
    std::lock_guard lock(view.mutex);
    change();
    view.changed.notify_all();
  };
  const auto ended = [&](const Status& status) { set([&] { view.ended = status; }); };
  const auto session =
      daemon.watch_session([&](const auto& s) { set([&] { view.session = s; }); }, false, ended);
  const auto ledger = daemon.ledger(0.25, [&](const auto& l) { set([&] { view.ledger = l; }); });
  const auto poses = daemon.poses([&](const auto& p) {
    set([&] {
      ++view.poses_seen;
      view.poses_missed += p.missed;
      view.poses = p;
    });
  });
  const auto events = daemon.events([&](const auto& e) {
    set([&] {
      view.last_event = fmt::format("{} {} {}", e.stream, e.kind, e.pressed ? "pressed" : "released");
    });
  });
  struct sigaction end {
  }, before{};
  end.sa_handler = [](int) { asked_to_end = true; };
  ::sigaction(SIGINT, &end, &before);
  const bool show = ::isatty(STDERR_FILENO) != 0;
  Screen screen;
  const Stopwatch watch;
  std::unique_lock lock(view.mutex);
  while (!asked_to_end && !view.ended && (duration_s <= 0 || watch.seconds() < duration_s)) {
    view.changed.wait_for(lock, std::chrono::milliseconds(200), [&] { return view.ended.has_value(); });
    if (show) screen.draw(lines_of(view));
  }
  ::sigaction(SIGINT, &before, nullptr);
  if (view.ended && !*view.ended) return tl::unexpected<Error>(view.ended->error());
  std::string text;
  if (!show)
    for (const std::string& line : lines_of(view)) text += line + "\n";
  CommandOutput output{text, dump_json(json_of(view)), false};
  lock.unlock();
  return output;
}

}  // namespace

void add_live(CLI::App& app, ChosenCommand& chosen) {
  auto duration_s = std::make_shared<double>(0);
  CLI::App* command =
      add_daemon_command(app, chosen, "live", "tags, rates, drops, latency and the jaw, as they are now",
                         [duration_s](DaemonClient& d) { return watch(d, *duration_s); });
  command->add_option("--duration-s", *duration_s, "end after so many seconds; else at Ctrl-C")
      ->check(CLI::PositiveNumber);
}

}  // namespace gnathion
