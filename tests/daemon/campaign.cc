// daemon_campaign latency|calls|kills|memory|all: the figures of docs/daemon.md, printed.
#include <fmt/format.h>

#include <cstdlib>
#include <string>

#include "tests/daemon/campaign_parts.h"

using namespace gnathion::testing;

namespace {

int failures = 0;

void fault(const std::string& text) {
  if (text.empty()) return;
  ++failures;
  fmt::print("FAULT: {}\n", text);
}

void latency() {
  const LatencyResult r = measure_latency(60, 1280, 720);
  fmt::print(
      "latency, 8 subscribers, one stalled, two 60 Hz streams of 1280x720 recorded, 60 s:\n"
      "  lane to subscriber: median {:.3f} ms, p99 {:.3f} ms, worst {:.1f} ms (published to subscriber: "
      "{:.3f}, {:.3f})\n"
      "  {} updates, {} missed by the seven; {} frames recorded, {} lost\n",
      r.median_ms, r.p99_ms, r.worst_ms, r.published_median_ms, r.published_p99_ms, r.updates, r.missed,
      r.recorded_frames, r.lost_frames);
  fault(r.fault);
}

void calls() {
  const CallsResult r = make_calls(10'000, 16, 0.01, 7);
  fmt::print(
      "calls: {} by 16 clients in {:.1f} s, {} connections cut, {} calls lost with them, {} wrong answers\n"
      "  memory {:.1f} to {:.1f} MiB, files {} to {}, afterwards {} connections, {} streams\n",
      r.calls, r.seconds, r.cuts, r.gone, r.wrong, r.memory_before_mib, r.memory_after_mib, r.files_before,
      r.files_after, r.connections_after, r.streams_after);
  fault(r.fault);
}

void kills() {
  const char* given = std::getenv("GNATHION_KILLS");
  const KillsResult r = kill_at_random(given ? std::atoi(given) : 200, 11);
  fmt::print(
      "kills: {}, {} while recording; {} recordings seen, {} half-written files, {} failed restarts, {} "
      "cases "
      "that do not open\n  at most {:.0f} ms lost, restart within {:.2f} s\n",
      r.kills, r.while_recording, r.recordings, r.half_written, r.failed_restarts, r.unopened,
      r.worst_lost_ms, r.worst_restart_s);
  fault(r.fault);
}

void memory() {
  const MemoryResult r = replay_poses(24);
  fmt::print("memory over 24 h of a 60 Hz pose stream:\n  hours  MiB    received   missed\n");
  for (const auto& row : r.rows)
    fmt::print("  {:>5.1f}  {:>5.1f}  {:>9}  {:>9}\n", row.hours, row.memory_mib, row.received, row.missed);
  fault(r.fault);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "all";
  if (what == "latency" || what == "all") latency();
  if (what == "calls" || what == "all") calls();
  if (what == "kills" || what == "all") kills();
  if (what == "memory" || what == "all") memory();
  return failures > 0;
}
