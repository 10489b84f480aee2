// Records from synthetic instruments until it is killed. Usage: recorder OUT.mcap LOG [WIDTH HEIGHT]
//
// LOG gets a DeliveredSample for each sample, and as such too: each change of what is synced (stream
// "synced", the bytes in arrival_ns), the longest sync so far ("longest sync", ns), and every 20 ms for how
// long the machine let this process wait
// ("waited", the microseconds in sequence).
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <thread>

#include "acquisition/session.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

void log_value(int fd, const char* name, std::int64_t value, std::uint32_t number = 0) {
  DeliveredSample entry;
  std::strncpy(entry.stream, name, sizeof entry.stream - 1);
  entry.sequence = number;
  entry.arrival_ns = value;
  GNATHION_CHECK(::write(fd, &entry, sizeof entry) == sizeof entry);
}

/// What the kernel tells of the session's threads: how long each stood ready without getting a core, and
/// whether the writer waits for the disk.
class Waits {
 public:
  /// Since the last call: the writer's wait for a core or the disk, and the longest of the other threads.
  double seconds(double tick_s) {
    std::map<std::string, double> now;
    double writer = 0, others = 0;
    for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
      std::string name, stat;
      double on_core_ns = 0, waited_ns = 0;
      std::ifstream(task.path() / "comm") >> name;
      std::ifstream(task.path() / "schedstat") >> on_core_ns >> waited_ns;
      const double before = before_.count(task.path()) ? before_[task.path()] : 0;
      now[task.path()] = waited_ns;
      double waited_s = 1e-9 * (waited_ns - before);
      if (name == "writer") {
        std::getline(std::ifstream(task.path() / "stat"), stat);
        if (stat.find(") D ") != std::string::npos) waited_s += tick_s;
        writer += waited_s;
      } else {
        others = std::max(others, waited_s);
      }
    }
    before_ = now;
    return writer + others;
  }

 private:
  std::map<std::string, double> before_;
};

void watch(Session& session, Clock& clock, int log) {
  std::uint64_t synced = 0;
  double longest_sync_s = 0;
  Waits waits;
  Stopwatch tick;
  while (true) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const SessionStatus status = session.status();
    if (status.synced_bytes != synced) {
      synced = status.synced_bytes;
      log_value(log, "synced", static_cast<std::int64_t>(synced));
    }
    if (status.longest_sync_s > longest_sync_s) {
      longest_sync_s = status.longest_sync_s;
      log_value(log, "longest sync", static_cast<std::int64_t>(1e9 * longest_sync_s));
    }
    if (tick.seconds() < 0.02) continue;
    const double waited_s = waits.seconds(tick.seconds());
    tick.restart();
    log_value(log, "waited", clock.now().ns, static_cast<std::uint32_t>(1e6 * waited_s));
  }
}

int record_until_killed(const char* out, const char* log_path, int width, int height) {
  SystemClock clock;
  const int log = ::open(log_path, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0600);
  GNATHION_CHECK(log >= 0);
  std::vector<Image8> images;
  for (std::uint64_t i = 0; i < 4; ++i) images.push_back(camera_like_image(width, height, i));
  std::vector<std::unique_ptr<Device>> devices;
  const auto add = [&](const char* stream, double rate_hz, SyntheticDevice::Maker maker) {
    devices.push_back(std::make_unique<SyntheticDevice>(SyntheticDevice::Options{stream, rate_hz, 0, log},
                                                        std::move(maker), clock));
  };
  add("camera_0", 60, camera_maker(images));
  add("camera_1", 60, camera_maker(images));
  add("tracker", 240, tracker_maker());
  add("pedal/raw", 100, transfer_maker());
  add("pedal", 3, pedal_maker());
  auto session = Session::start(out, std::move(devices), {}, clock);
  if (!session) {
    std::fprintf(stderr, "%s\n", session.error().line().c_str());
    return 1;
  }
  watch(**session, clock, log);
  return 0;
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // never outlives the test
  return gnathion::record_until_killed(argv[1], argv[2], argc > 3 ? std::atoi(argv[3]) : 320,
                                       argc > 4 ? std::atoi(argv[4]) : 240);
}
