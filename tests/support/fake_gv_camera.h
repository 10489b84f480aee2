// Aravis's own fake GigE Vision camera as a process on loopback.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

namespace gnathion::test {

/// GigE Vision's control port is fixed (UDP 3956), so that there can be one fake camera a machine: whoever
/// needs it waits here for the other test programs.
class FakeGvPort {
 public:
  FakeGvPort() {
    const auto path = std::filesystem::temp_directory_path() / "gnathion_gvcp_3956.lock";
    file_ = ::open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
    while (file_ >= 0 && ::flock(file_, LOCK_EX) != 0) {
    }
  }
  ~FakeGvPort() {
    if (file_ >= 0) ::close(file_);
  }
  FakeGvPort(const FakeGvPort&) = delete;
  FakeGvPort& operator=(const FakeGvPort&) = delete;

 private:
  int file_ = -1;
};

class FakeGvCamera {
 public:
  explicit FakeGvCamera(std::vector<std::string> options = {}) : options_(std::move(options)) { start(); }
  ~FakeGvCamera() { kill(); }
  FakeGvCamera(const FakeGvCamera&) = delete;
  FakeGvCamera& operator=(const FakeGvCamera&) = delete;

  void start() {
    std::vector<std::string> words = {"arv-fake-gv-camera-0.8", "-i", "127.0.0.1"};
    words.insert(words.end(), options_.begin(), options_.end());
    std::vector<char*> arguments;
    for (std::string& w : words) arguments.push_back(w.data());
    arguments.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ != 0) return;
    const int null = ::open("/dev/null", O_RDWR);
    ::dup2(null, 1);
    ::dup2(null, 2);
    ::execvp(arguments[0], arguments.data());
    ::_exit(127);
  }
  /// As if the plug were pulled.
  void kill() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }
  /// Frozen: it keeps its address, and answers nothing.
  void freeze() { ::kill(pid_, SIGSTOP); }
  void thaw() { ::kill(pid_, SIGCONT); }
  bool runs() const { return pid_ > 0 && ::waitpid(pid_, nullptr, WNOHANG) == 0; }

 private:
  std::vector<std::string> options_;
  pid_t pid_ = -1;
};

}  // namespace gnathion::test
