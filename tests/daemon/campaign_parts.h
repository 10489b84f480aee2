// The measurements of the daemon, long (daemon_campaign) or short (robustness_test). Each returns what it
// found.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace gnathion::testing {

struct LatencyResult {
  double median_ms = 0, p99_ms = 0, worst_ms = 0;        ///< arrival in the lane → callback
  double published_median_ms = 0, published_p99_ms = 0;  ///< pose there → callback
  std::uint64_t updates = 0, missed = 0, stalled_seen = 0;
  std::uint64_t recorded_frames = 0, lost_frames = 0;  ///< of the two cameras
  std::string fault;
};
/// Eight subscribers, one of them stalled, while two 60 Hz streams of `width`×`height` are recorded.
LatencyResult measure_latency(double seconds, int width_px, int height_px);

struct CallsResult {
  int calls = 0, cuts = 0, gone = 0, wrong = 0;
  double seconds = 0, memory_before_mib = 0, memory_after_mib = 0;
  int files_before = 0, files_after = 0;
  unsigned connections_after = 0, streams_after = 0;
  std::string fault;
};
CallsResult make_calls(int calls, int clients, double cut_share, std::uint64_t seed);

struct KillsResult {
  int kills = 0, while_recording = 0, recordings = 0, half_written = 0, failed_restarts = 0, unopened = 0;
  double worst_lost_ms = 0, worst_restart_s = 0;
  std::string fault;
};
KillsResult kill_at_random(int kills, std::uint64_t seed);

struct MemoryResult {
  struct Row {
    double hours = 0;
    double memory_mib = 0;
    std::uint64_t received = 0, missed = 0;
  };
  std::vector<Row> rows;
  std::string fault;
};
/// `hours` of a 60 Hz pose stream without waiting, with one quick and one slow subscriber.
MemoryResult replay_poses(double hours);

}  // namespace gnathion::testing
