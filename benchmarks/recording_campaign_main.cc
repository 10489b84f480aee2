// What it takes to record two cameras of 1280x720 px at 60 Hz without loss, and to replay that.
// Usage: recording_campaign OUT.mcap [SECONDS]
//
// The pictures are frames of the phantom's film (noise of 2 grey levels), rendered beforehand; each frame
// that is recorded is a copy of one of them, as a driver's buffer would be. A second process replays the
// file.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "acquisition/session.h"
#include "phantom/film.h"
#include "phantom/film_scene.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

constexpr int kWidth_px = 1280, kHeight_px = 720;

double cpu_s(const timeval& t) {
  return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
}

double process_cpu_s() {
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  return cpu_s(used.ru_utime) + cpu_s(used.ru_stime);
}

std::vector<Image8> film_frames(std::size_t count) {
  FilmOptions options;
  PhantomFilm film(film_scene(make_phantom_patient(1)), options);
  std::vector<Image8> images;
  while (images.size() < count) {
    auto sample = film.next();
    GNATHION_CHECK(sample.has_value() && sample->has_value());
    if (auto* frame = std::get_if<FrameSample>(&**sample)) images.push_back(std::move(frame->image));
  }
  GNATHION_CHECK(images[0].width_px == kWidth_px && images[0].height_px == kHeight_px);
  return images;
}

int record_two_cameras(const char* path, double seconds) {
  std::vector<Image8> images = film_frames(24);
  const double images_mib = static_cast<double>(images.size() * images[0].pixels.size()) / 1048576.0;
  SystemClock clock;
  const auto frames = static_cast<std::uint32_t>(60 * seconds);
  std::vector<std::unique_ptr<Device>> devices;
  std::vector<const SyntheticDevice*> cameras;
  const SyntheticDevice::Maker maker = [&images](SampleHeader h) -> Sample {
    const Image8& image = images[h.sequence % images.size()];
    return FrameSample{std::move(h), image};
  };
  for (const char* stream : {"camera_0", "camera_1"}) {
    auto camera =
        std::make_unique<SyntheticDevice>(SyntheticDevice::Options{stream, 60, frames, -1}, maker, clock);
    cameras.push_back(camera.get());
    devices.push_back(std::move(camera));
  }
  rusage before{}, after{};
  ::getrusage(RUSAGE_SELF, &before);
  auto session = Session::start(path, std::move(devices), {}, clock);
  GNATHION_CHECK(session.has_value());
  (*session)->wait_for(10 * seconds + 100);
  const Status status = (*session)->finish();
  ::getrusage(RUSAGE_SELF, &after);
  const SessionStatus s = (*session)->status();
  const double user_s = cpu_s(after.ru_utime) - cpu_s(before.ru_utime);
  const double system_s = cpu_s(after.ru_stime) - cpu_s(before.ru_stime);
  std::uint64_t received = 0, lost = 0;
  for (const auto& [stream, counts] : s.ledger) {
    received += counts.received;
    lost += counts.missing;
    for (const auto& [reason, n] : counts.rejected) lost += n;
  }
  const double raw_mb = static_cast<double>(received) * kWidth_px * kHeight_px * 1e-6;
  fmt::print("recording, 2 x {} x {} px, 60 Hz, {:.1f} s{}\n", kWidth_px, kHeight_px, s.elapsed_s,
             status ? "" : ": " + status.error().line());
  fmt::print("  frames received / lost          {} / {}\n", received, lost);
  fmt::print("  raw, in the file                {:.1f} MB/s, {:.1f} MB/s ({:.0f} MB)\n", raw_mb / s.elapsed_s,
             1e-6 * static_cast<double>(s.file_bytes) / s.elapsed_s,
             1e-6 * static_cast<double>(s.file_bytes));
  fmt::print("  CPU, whole process              {:.1f} % of a core (user {:.1f} %, kernel {:.1f} %)\n",
             100 * (user_s + system_s) / s.elapsed_s, 100 * user_s / s.elapsed_s,
             100 * system_s / s.elapsed_s);
  fmt::print(
      "  peak memory                     {:.0f} MiB, of which {:.0f} MiB are the pictures to choose from\n",
      peak_rss_mib(), images_mib);
  fmt::print("  queue, fullest                  {:.1f} of {:.0f} MiB\n",
             static_cast<double>(s.queue_peak_bytes) / 1048576.0,
             static_cast<double>(s.queue_capacity_bytes) / 1048576.0);
  fmt::print("  longest sync, write of a chunk  {:.0f} ms, {:.0f} ms\n", 1e3 * s.longest_sync_s,
             1e3 * s.longest_write_s);
  fmt::print("  cameras waited for a core       {:.0f} ms at most\n",
             1e3 * std::max(cameras[0]->longest_delay_s(), cameras[1]->longest_delay_s()));
  return status && lost == 0 && received == 2 * frames ? 0 : 1;
}

/// Opening and seeking, the file's pages dropped from the cache before each; then all of it.
int replay_from_any_time(const char* path) {
  const double at_start_mib = peak_rss_mib();
  Random random(17);
  double worst_s = 0, sum_s = 0, cpu_sum_s = 0;
  constexpr int kSeeks = 40;
  for (int i = 0; i < kSeeks; ++i) {
    const int fd = ::open(path, O_RDONLY | O_CLOEXEC);
    ::posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    ::close(fd);
    const double cpu_before_s = process_cpu_s();
    const Stopwatch watch;
    auto source = RecordingSource::open(path);
    GNATHION_CHECK(source.has_value());
    const auto range = *(*source)->time_range();
    const HostTime from{
        range.first.ns +
        static_cast<std::int64_t>(random.uniform() * static_cast<double>(range.second.ns - range.first.ns))};
    GNATHION_CHECK((*source)->seek(from).has_value());
    const auto sample = (*source)->next();
    const double took_s = watch.seconds();
    GNATHION_CHECK(sample.has_value() && sample->has_value() && header_of(**sample).arrival >= from);
    worst_s = std::max(worst_s, took_s);
    sum_s += took_s;
    cpu_sum_s += process_cpu_s() - cpu_before_s;
  }
  fmt::print(
      "  open, seek, first sample, cold  {:.1f} ms on average ({:.1f} ms of a core), {:.1f} ms at worst of "
      "{}\n",
      1e3 * sum_s / kSeeks, 1e3 * cpu_sum_s / kSeeks, 1e3 * worst_s, kSeeks);
  auto source = RecordingSource::open(path);
  const Stopwatch watch;
  std::uint64_t samples = 0;
  while (true) {
    const auto next = (*source)->next();
    GNATHION_CHECK(next.has_value());
    if (!*next) break;
    ++samples;
  }
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  fmt::print("  all of it                       {} samples in {:.1f} s\n", samples, watch.seconds());
  fmt::print("  peak memory                     {:.1f} MiB, {:.1f} MiB of them before the file was opened\n",
             peak_rss_mib(), at_start_mib);
  return 0;
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  if (argc > 2 && std::string(argv[1]) == "--replay") return gnathion::replay_from_any_time(argv[2]);
  if (argc < 2) {
    std::fprintf(stderr, "usage: recording_campaign OUT.mcap [SECONDS]\n");
    return 2;
  }
  const int recorded = gnathion::record_two_cameras(argv[1], argc > 2 ? std::atof(argv[2]) : 60);
  std::printf("replay\n");
  std::fflush(stdout);
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl("/proc/self/exe", argv[0], "--replay", argv[1], nullptr);
    ::_exit(127);
  }
  int how = 0;
  ::waitpid(child, &how, 0);
  return recorded != 0 ? recorded : WEXITSTATUS(how);
}
