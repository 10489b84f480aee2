#include "tests/daemon/campaign_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <thread>

#include "acquisition/recording.h"
#include "core/file.h"
#include "core/random.h"
#include "tests/daemon/cut_proxy.h"
#include "tests/daemon/daemon_process.h"

namespace gnathion::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  const auto at = static_cast<std::size_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

int open_files(int pid) {
  int n = 0;
  std::error_code ec;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(fmt::format("/proc/{}/fd", pid), ec)) ++n;
  return n;
}

/// A daemon with a case and a replayed film of cameras and poses.
struct Bench {
  Bench(const SmallRecording& film, double speed) : daemon(folder.path()) {
    const fs::path file = folder.path() / "cases/incoming/film.mcap";
    fs::create_directories(file.parent_path());
    write_small_recording(file, film);
    if (!daemon.start()) {
      fault = "the daemon does not start: " + daemon.log();
      return;
    }
    client = daemon.connect();
    (void)client->create_case("case-1");
    const auto configured = client->configure_devices(replay_devices(file, speed));
    if (!configured) fault = configured.error().line();
  }
  TemporaryFolder folder;
  DaemonProcess daemon;
  std::unique_ptr<client::DaemonClient> client;
  std::string fault;
};

}  // namespace

LatencyResult measure_latency(double seconds, int width_px, int height_px) {
  LatencyResult r;
  SmallRecording film;
  film.duration_s = seconds + 5;
  film.width_px = width_px;
  film.height_px = height_px;
  Bench bench(film, 1);
  if (!bench.fault.empty()) return r.fault = bench.fault, r;
  SystemClock clock;
  std::mutex mutex;
  std::vector<double> from_arrival, from_published;
  std::vector<std::unique_ptr<client::DaemonClient>> clients;
  std::vector<std::unique_ptr<client::Subscription>> subscriptions;
  for (int i = 0; i < 7; ++i) {
    clients.push_back(bench.daemon.connect());
    subscriptions.push_back(clients.back()->poses([&](const client::PoseUpdate& p) {
      const HostTime now = clock.now();
      std::lock_guard lock(mutex);
      from_arrival.push_back(1e3 * now.seconds_since(p.arrival));
      from_published.push_back(1e3 * now.seconds_since(p.published));
      r.missed += p.missed;
    }));
  }
  std::atomic<bool> over{false};
  std::atomic<std::uint64_t> stalled_seen{0};
  clients.push_back(bench.daemon.connect());
  auto stalled = clients.back()->poses([&](const client::PoseUpdate&) {
    ++stalled_seen;
    while (!over) std::this_thread::sleep_for(milliseconds(5));
  });
  const auto armed = bench.client->arm("case-1");
  const auto started = bench.client->start();
  if (!armed || !started) return r.fault = "no recording", r;
  std::this_thread::sleep_for(milliseconds(static_cast<int>(1000 * seconds)));
  const auto stopped = bench.client->stop();
  over = true;
  stalled.reset();
  subscriptions.clear();
  if (!stopped) return r.fault = stopped.error().line(), r;
  r.stalled_seen = stalled_seen;
  r.updates = from_arrival.size();
  r.median_ms = quantile(from_arrival, 0.5);
  r.p99_ms = quantile(from_arrival, 0.99);
  r.worst_ms = quantile(from_arrival, 1);
  r.published_median_ms = quantile(from_published, 0.5);
  r.published_p99_ms = quantile(from_published, 0.99);
  const auto summary = summarise_recording(bench.daemon.cases() / "case-1" / started->recording);
  if (!summary || !summary->whole) return r.fault = "the recording is not whole", r;
  for (const char* camera : {"camera_0", "camera_1"}) {
    const StreamSummary& s = summary->streams.at(camera);
    r.recorded_frames += s.received;
    r.lost_frames += s.missing;
    for (const auto& [reason, n] : s.rejected) r.lost_frames += n;
  }
  return r;
}

CallsResult make_calls(int calls, int clients, double cut_share, std::uint64_t seed) {
  CallsResult r;
  Bench bench(SmallRecording{}, 1);
  if (!bench.fault.empty()) return r.fault = bench.fault, r;
  for (int i = 2; i <= 5; ++i) (void)bench.client->create_case(fmt::format("case-{}", i));
  const auto health_of = [&] { return bench.client->health().value_or(client::Health{}); };
  std::mutex mutex;
  std::atomic<int> cuts{0}, gone{0}, wrong{0}, done{0};
  const auto judge = [&](bool right, const Status& status, const std::string& what) {
    ++done;
    if (right) return;
    if (!status && status.error().code == ErrorCode::kInternal) {
      ++gone;  // the connection was cut under it
      return;
    }
    ++wrong;
    std::lock_guard lock(mutex);
    r.fault = what + ": " + (status ? "wrong answer" : status.error().line());
  };
  const auto status_of = [](const auto& result) {
    return result ? Status() : Status(tl::unexpected<Error>(result.error()));
  };
  const auto work = [&](int number) {
    Random random(seed + static_cast<std::uint64_t>(number));
    CutProxy proxy((bench.folder.path() / fmt::format("p{}", number)).string(), bench.daemon.socket());
    auto connected = client::DaemonClient::connect(proxy.path(), 20);
    for (int i = 0; i < calls / clients && connected; ++i) {
      auto& c = **connected;
      std::thread cutter;
      if (random.uniform(0, 1) < cut_share) {
        ++cuts;
        cutter = std::thread([&proxy, wait = random.uniform(0, 3)] {
          std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(wait));
          proxy.cut();
        });
      }
      const std::string id = fmt::format("case-{}", 1 + i % 5);
      switch (i % 8) {
        case 0: {
          const auto x = c.open_case(id);
          judge(x && x->id == id && x->problem.empty(), status_of(x), "open");
          break;
        }
        case 1: {
          const auto x = c.cases();
          judge(x && x->size() == 5, status_of(x), "list");
          break;
        }
        case 2: {
          const auto x = c.session();
          judge(x && x->state == client::SessionState::kIdle, status_of(x), "session");
          break;
        }
        case 3: {
          const auto x = c.open_case("nobody");
          judge(!x && x.error().code == ErrorCode::kInput, status_of(x), "open nobody");
          break;
        }
        case 4: {
          const auto x = c.mark("MI");
          judge(!x && x.error().code == ErrorCode::kUsage, status_of(x), "mark while idle");
          break;
        }
        case 5: {
          const auto x = c.job_kinds();
          judge(x && x->size() > 8, status_of(x), "kinds");
          break;
        }
        case 6: {
          std::atomic<int> seen{0};
          const auto x = c.watch_session([&](const auto&) { ++seen; }, i % 16 == 6);
          eventually([&] { return seen > 0; }, 0.2);
          ++done;
          break;
        }
        default: {
          const auto x = c.devices();
          judge(x && x->size() == 1 && x->front().stream == "replay", status_of(x), "devices");
        }
      }
      if (cutter.joinable()) cutter.join();
    }
  };
  const auto round = [&](int n) {
    std::vector<std::thread> threads;
    for (int k = 0; k < n; ++k) threads.emplace_back(work, k);
    for (std::thread& t : threads) t.join();
  };
  r.memory_before_mib = health_of().memory_mib;
  r.files_before = open_files(bench.daemon.pid());
  const Stopwatch watch;
  round(clients);
  r.seconds = watch.seconds();
  eventually([&] { return health_of().connections <= 1 && health_of().streams == 0; }, 10);
  const client::Health health = health_of();
  r.memory_after_mib = health.memory_mib;
  r.connections_after = health.connections;
  r.streams_after = health.streams;
  r.files_after = open_files(bench.daemon.pid());
  r.calls = done;
  r.cuts = cuts;
  r.gone = gone;
  r.wrong = wrong;
  if (!health.well && r.fault.empty()) r.fault = "the daemon is not well afterwards";
  return r;
}

KillsResult kill_at_random(int kills, std::uint64_t seed) {
  KillsResult r;
  SmallRecording film;
  film.duration_s = 30;
  Bench bench(film, 1);
  if (!bench.fault.empty()) return r.fault = bench.fault, r;
  Random random(seed);
  fs::copy_file(bench.folder.path() / "cases/incoming/film.mcap", bench.daemon.cases() / "case-1/film.mcap");
  const client::JobRequest job{
      "case-1", "track", {{"recording", "film.mcap"}, {"rig", "film.mcap"}, {"out", "m.mcap"}}, false};
  const fs::path case_toml = bench.daemon.cases() / "case-1/case.toml";
  const std::string as_created = read_file(case_toml).value_or("");
  std::map<std::string, std::uint32_t> last_seen;  ///< by recording: the last pose that a subscriber had
  for (int i = 0; i < kills && r.fault.empty(); ++i) {
    std::atomic<std::uint32_t> sequence{0};
    std::string recording;
    std::mutex mutex;
    auto poses = bench.client->poses([&](const client::PoseUpdate& p) { sequence = p.sequence; });
    std::atomic<bool> over{false};
    std::thread session([&] {  // goes on until the daemon is gone
      auto c = bench.daemon.connect();
      if (!c || !c->arm("case-1")) return;
      while (!over) {
        (void)c->submit(job);
        const auto started = c->start();
        if (!started) return;
        {
          std::lock_guard lock(mutex);
          recording = started->recording;
        }
        for (int k = 0; k < 4 && !over; ++k) {
          if (!c->mark(k % 2 ? "TP" : "MI")) return;
          std::this_thread::sleep_for(milliseconds(60));
        }
        {
          std::lock_guard lock(mutex);
          recording.clear();
        }
        if (!c->stop()) return;
      }
    });
    std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(random.uniform(0, 900)));
    std::uint32_t seen = 0;
    std::string running;
    {
      std::lock_guard lock(mutex);
      seen = sequence;
      running = recording;
    }
    bench.daemon.kill_and_wait();
    over = true;
    session.join();
    poses.reset();
    ++r.kills;
    const Stopwatch watch;
    if (!bench.daemon.start()) {
      ++r.failed_restarts;
      r.fault = "no restart: " + bench.daemon.log();
      break;
    }
    r.worst_restart_s = std::max(r.worst_restart_s, watch.seconds());
    bench.client = bench.daemon.connect();
    const auto opened = bench.client->open_case("case-1");
    if (!opened || !opened->problem.empty()) {
      ++r.unopened;
      r.fault = opened ? opened->problem : opened.error().line();
    }
    for (const auto& entry : fs::recursive_directory_iterator(bench.daemon.cases() / "case-1"))
      if ((entry.path().filename().string().rfind('.', 0) == 0 && entry.path().filename() != ".lock") ||
          entry.path().extension() == ".recovered") {
        ++r.half_written;
        r.fault = "left behind: " + entry.path().string();
      }
    std::error_code ec;
    for (const auto& entry : fs::directory_iterator(bench.daemon.cases() / "case-1/recordings", ec)) {
      const auto summary = summarise_recording(entry.path());
      ++r.recordings;
      if (!summary || !summary->whole) {
        ++r.half_written;
        r.fault = "not whole: " + entry.path().string();
        continue;
      }
      if (running.empty() || entry.path().filename() != fs::path(running).filename()) continue;
      ++r.while_recording;
      std::uint32_t last = 0;
      const auto source = RecordingSource::open(entry.path());
      while (source) {
        const auto next = (*source)->next();
        if (!next || !*next) break;
        if (const auto* pose = std::get_if<PoseSample>(&**next)) last = pose->header.sequence;
      }
      if (last > 0 && seen > last)
        r.worst_lost_ms = std::max(r.worst_lost_ms, 1e3 * (seen - last) / film.rate_hz);
    }
    fs::remove_all(bench.daemon.cases() / "case-1/recordings", ec);
    (void)write_file(case_toml, as_created);  // it named one of them
  }
  return r;
}

MemoryResult replay_poses(double hours) {
  MemoryResult r;
  SmallRecording film;
  film.cameras = 0;
  film.duration_s = 600;
  Bench bench(film, 0);
  if (!bench.fault.empty()) return r.fault = bench.fault, r;
  std::atomic<std::uint64_t> received{0}, missed{0};
  const auto quick = bench.client->poses([&](const client::PoseUpdate& p) {
    ++received;
    missed += p.missed;
  });
  const auto other = bench.daemon.connect();
  const auto slow =
      other->poses([](const client::PoseUpdate&) { std::this_thread::sleep_for(milliseconds(20)); });
  const int sessions = static_cast<int>(hours * 6 + 0.5);
  for (int i = 0; i <= sessions; ++i) {
    if (i % std::max(1, sessions / 12) == 0)
      r.rows.push_back(
          {i / 6.0, bench.client->health().value_or(client::Health{}).memory_mib, received, missed});
    if (i == sessions) break;
    const auto armed = bench.client->arm("case-1");
    if (!armed) return r.fault = armed.error().line(), r;
    const bool ended = eventually(
        [&] {
          const auto devices = bench.client->devices();
          return devices && !devices->empty() && devices->front().state == "stopped";
        },
        120);
    if (!ended) return r.fault = "a replay did not end", r;
    if (const auto disarmed = bench.client->disarm(); !disarmed) return r.fault = disarmed.error().line(), r;
  }
  return r;
}

}  // namespace gnathion::testing
