// gnathiond as a child process with folders of its own, and recordings that stand for instruments.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client/daemon_client.h"

namespace gnathion::testing {

/// A folder that goes with its object.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

class DaemonProcess {
 public:
  /// `more`: further lines of gnathiond.toml. The case root is `folder`/cases.
  explicit DaemonProcess(const std::filesystem::path& folder, const std::string& more = {});
  ~DaemonProcess();  ///< kills it
  /// Starts it and waits until it answers.
  bool start();
  void signal(int number) const;
  /// Its exit code, or 1000 + the signal that ended it.
  int wait();
  void kill_and_wait();
  bool running() const { return pid_ > 0; }
  int pid() const { return pid_; }
  std::unique_ptr<client::DaemonClient> connect() const;
  std::string socket() const { return (folder_ / "d.sock").string(); }
  std::filesystem::path cases() const { return folder_ / "cases"; }
  std::filesystem::path state() const { return folder_ / "state"; }
  std::filesystem::path config() const { return folder_ / "gnathiond.toml"; }
  std::string log() const;
  static std::string program();  ///< gnathion

 private:
  std::filesystem::path folder_;
  int pid_ = 0;
  mutable int log_part_ = 0;
};

/// Runs a program to its end; its exit code. `output` gets what it prints.
int run_program(std::vector<std::string> arguments, std::string* output = nullptr, double limit_s = 120);

/// Waits until `condition` holds; false when it did not within `limit_s`.
bool eventually(const std::function<bool()>& condition, double limit_s = 30);

/// A recording of a sensor's poses and of small pictures: instruments that cost nothing.
struct SmallRecording {
  double duration_s = 20, rate_hz = 60;
  int cameras = 2, width_px = 64, height_px = 48;
  bool poses = true;
};
void write_small_recording(const std::filesystem::path& file, const SmallRecording& what);
/// devices.toml with one replayed recording.
std::string replay_devices(const std::filesystem::path& recording, double speed = 1);

}  // namespace gnathion::testing
