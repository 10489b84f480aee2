#include "tests/daemon/daemon_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <sstream>
#include <thread>

#include "acquisition/recording.h"

extern char** environ;

namespace gnathion::testing {

namespace fs = std::filesystem;
namespace {

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

int spawn(std::vector<std::string> arguments, const fs::path& output) {
  std::vector<char*> argv;
  for (std::string& a : arguments) argv.push_back(a.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  ::posix_spawn_file_actions_init(&files);
  ::posix_spawn_file_actions_addopen(&files, 1, output.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  ::posix_spawn_file_actions_adddup2(&files, 1, 2);
  int pid = 0;
  const bool started = ::posix_spawn(&pid, argv[0], &files, nullptr, argv.data(), environ) == 0;
  ::posix_spawn_file_actions_destroy(&files);
  return started ? pid : -1;
}

int ended_as(int status) {
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

}  // namespace

TemporaryFolder::TemporaryFolder() {
  std::string name = (fs::temp_directory_path() / "gnathiond_XXXXXX").string();
  path_ = ::mkdtemp(name.data());
}
TemporaryFolder::~TemporaryFolder() {
  std::error_code ec;
  fs::remove_all(path_, ec);
}

DaemonProcess::DaemonProcess(const fs::path& folder, const std::string& more) : folder_(folder) {
  fs::create_directories(cases());
  fs::create_directories(state());
  std::ofstream(config())
      << "[daemon]\ncase_root = \"cases\"\nstate = \"state\"\nsocket = \"d.sock\"\n"
      << "[jobs]\nprogram = \"" << GNATHION_PROGRAM << "\"\n"
      << (more.find("[capture]") == std::string::npos ? "[capture]\ndevices = \"state/devices.toml\"\n" : "")
      << (more.find("[openigtlink]") == std::string::npos ? "[openigtlink]\nenabled = false\n" : "") << more;
}

DaemonProcess::~DaemonProcess() {
  kill_and_wait();
}

std::string DaemonProcess::program() {
  return GNATHION_PROGRAM;
}

bool DaemonProcess::start() {
  pid_ = std::max(0, spawn({GNATHIOND, "--config", config().string()}, folder_ / "log"));
  if (pid_ == 0) return false;
  bool answers = false;
  eventually([&] {
    answers = client::DaemonClient::connect(socket(), 0.2).has_value();
    if (!answers && ::waitpid(pid_, nullptr, WNOHANG) != 0) pid_ = 0;  // it has ended
    return answers || pid_ == 0;
  });
  return answers;
}

void DaemonProcess::signal(int number) const {
  if (pid_ > 0) ::kill(pid_, number);
}

int DaemonProcess::wait() {
  int status = 0, seen = 0;
  if (pid_ <= 0 || !eventually([&] { return (seen = ::waitpid(pid_, &status, WNOHANG)) != 0; }, 60))
    return -1;
  pid_ = 0;
  return seen > 0 ? ended_as(status) : -1;
}

void DaemonProcess::kill_and_wait() {
  if (pid_ <= 0) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
  pid_ = 0;
}

std::unique_ptr<client::DaemonClient> DaemonProcess::connect() const {
  auto connected = client::DaemonClient::connect(socket(), 20);
  return connected ? std::move(*connected) : nullptr;
}

std::string DaemonProcess::log() const {
  return text_of(folder_ / "log");
}

int run_program(std::vector<std::string> arguments, std::string* output, double limit_s) {
  const TemporaryFolder folder;
  const int pid = spawn(std::move(arguments), folder.path() / "out");
  int status = 0, seen = 0;
  if (pid <= 0) {  // never wait for, or signal, "all processes"
    if (output) *output = "cannot be started";
    return -1;
  }
  if (!eventually([&] { return (seen = ::waitpid(pid, &status, WNOHANG)) != 0; }, limit_s)) {
    ::kill(pid, SIGKILL);
    seen = ::waitpid(pid, &status, 0);
  }
  if (output) *output = text_of(folder.path() / "out");
  return seen > 0 ? ended_as(status) : -1;
}

bool eventually(const std::function<bool()>& condition, double limit_s) {
  const Stopwatch watch;
  while (watch.seconds() < limit_s) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return condition();
}

void write_small_recording(const fs::path& file, const SmallRecording& what) {
  RecordingOptions options;
  options.reserve_space = false;
  auto writer = RecordingWriter::create(file, options);
  const auto samples = static_cast<std::uint32_t>(what.duration_s * what.rate_hz);
  for (std::uint32_t i = 0; i < samples; ++i) {
    const HostTime time{1'000'000'000 + static_cast<std::int64_t>(1e9 * i / what.rate_hz)};
    for (int c = 0; c < what.cameras; ++c) {
      FrameSample frame{{fmt::format("camera_{}", c), i, time, time, {time.ns}},
                        Image8(what.width_px, what.height_px)};
      for (std::size_t k = 0; k < frame.image.pixels.size(); ++k)
        frame.image.pixels[k] =
            static_cast<std::uint8_t>((k * 7 + i * 13 + static_cast<std::uint32_t>(c)) & 0xff);
      (void)writer->write(frame);
    }
    if (!what.poses) continue;
    PoseSample pose{{"tracker/1", i, time, time, {time.ns}}, "transmitter", "sensor_1", true, {}, {}};
    pose.reference_from_body = Rigid3::about_axis({0, 0, 0}, {0, 0, 1}, 0.001 * i);
    pose.reference_from_body.translation_mm = {std::sin(0.01 * i), 2, 3};
    (void)writer->write(pose);
  }
  (void)writer->finish();
}

std::string replay_devices(const fs::path& recording, double speed) {
  return fmt::format("[[device]]\nkind = \"replay\"\nname = \"replay\"\npath = \"{}\"\nspeed = {}\n",
                     recording.string(), speed);
}

}  // namespace gnathion::testing
