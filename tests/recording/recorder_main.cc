// Records from synthetic instruments until it is killed. Usage: recorder OUT.mcap LOG [WIDTH HEIGHT]
//
// LOG gets a DeliveredSample for each sample, and one for each change of what is synced (stream "synced", the
// bytes in arrival_ns), for the longest sync so far ("longest sync", ns), and for each time this process was
// not run when it asked to be ("stall", ns).
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "acquisition/session.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

void log_value(int fd, const char* name, std::int64_t value) {
  DeliveredSample entry;
  std::strncpy(entry.stream, name, sizeof entry.stream - 1);
  entry.arrival_ns = value;
  GNATHION_CHECK(::write(fd, &entry, sizeof entry) == sizeof entry);
}

void watch(Session& session, int log) {
  std::uint64_t synced = 0;
  double longest_sync_s = 0;
  while (true) {
    const Stopwatch watch;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const double stall_s = watch.seconds() - 0.005;
    if (stall_s > 0.01) log_value(log, "stall", static_cast<std::int64_t>(1e9 * stall_s));
    const SessionStatus status = session.status();
    if (status.synced_bytes != synced) {
      synced = status.synced_bytes;
      log_value(log, "synced", static_cast<std::int64_t>(synced));
    }
    if (status.longest_sync_s > longest_sync_s) {
      longest_sync_s = status.longest_sync_s;
      log_value(log, "longest sync", static_cast<std::int64_t>(1e9 * longest_sync_s));
    }
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
  watch(**session, log);
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
