#include "daemon/jobs/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/file.h"
#include "core/time.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMaxOutput = std::size_t{16} << 20;
constexpr int kProgressFd = 3;
constexpr double kGrace_s = 0.2;

/// The environment of a job: nothing of the daemon's but what programs need.
std::vector<std::string> environment_for(const fs::path& work) {
  std::vector<std::string> variables = {fmt::format("GNATHION_PROGRESS_FD={}", kProgressFd),
                                        "TMPDIR=" + work.string(), "HOME=" + work.string(), "LC_ALL=C.UTF-8"};
  for (const char* name : {"PATH", "LD_LIBRARY_PATH", "ASAN_OPTIONS", "TSAN_OPTIONS"})
    if (const char* value = std::getenv(name)) variables.push_back(fmt::format("{}={}", name, value));
  return variables;
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> list;
  for (std::string& text : texts) list.push_back(text.data());
  list.push_back(nullptr);
  return list;
}

struct Pipe {
  int read_end = -1, write_end = -1;
  ~Pipe() {
    close_write();
    if (read_end >= 0) ::close(read_end);
  }
  void close_write() {
    if (write_end >= 0) ::close(write_end);
    write_end = -1;
  }
};

Result<pid_t> spawn(const ChildOrder& order, const Pipe& pipe) {
  std::vector<std::string> arguments = order.arguments;
  arguments.insert(arguments.begin(), order.program.string());
  std::vector<std::string> environment = environment_for(order.work);
  posix_spawn_file_actions_t files;
  ::posix_spawn_file_actions_init(&files);
  const std::string out = (order.work / "stdout").string(), err = (order.work / "stderr").string();
  constexpr int kWrite = O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC;
  ::posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&files, 1, out.c_str(), kWrite & ~O_CLOEXEC, 0600);
  ::posix_spawn_file_actions_addopen(&files, 2, err.c_str(), kWrite & ~O_CLOEXEC, 0600);
  ::posix_spawn_file_actions_adddup2(&files, pipe.write_end, kProgressFd);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  ::posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
  sigset_t all, none;
  ::sigfillset(&all);
  ::sigemptyset(&none);
  ::posix_spawnattr_setsigdefault(&attributes, &all);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  pid_t pid = 0;
  const int failed = ::posix_spawn(&pid, order.program.c_str(), &files, &attributes,
                                   pointers(arguments).data(), pointers(environment).data());
  ::posix_spawn_file_actions_destroy(&files);
  ::posix_spawnattr_destroy(&attributes);
  // 0, 1 and less would stand for whole groups of processes in what follows.
  if (failed != 0 || pid <= 1)
    return fail(ErrorCode::kInternal, "cannot start job", order.program.string(), std::strerror(failed));
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(pid), order.nice);
  return pid;
}

/// Lines of cli/terminal_progress: "S <share> <name>" begins a step, "U <fraction>" goes on with it.
class ProgressReader {
 public:
  explicit ProgressReader(const std::function<void(const ChildProgress&)>& report) : report_(report) {}
  void feed(const char* bytes, std::size_t n) {
    text_.append(bytes, n);
    for (std::size_t end; (end = text_.find('\n')) != std::string::npos; text_.erase(0, end + 1))
      line(text_.substr(0, end));
    if (text_.size() > 4096) text_.clear();
  }

 private:
  void line(const std::string& l) {
    if (l.size() < 3) return;
    if (l[0] == 'S') {
      done_ = std::min(1.0, done_ + share_);
      const std::size_t space = l.find(' ', 2);
      if (space == std::string::npos) return;
      share_ = std::clamp(std::atof(l.c_str() + 2), 0.0, 1.0);
      now_ = {l.substr(space + 1), 0, done_};
    } else if (l[0] == 'U') {
      now_.step_fraction = std::clamp(std::atof(l.c_str() + 2), 0.0, 1.0);
      now_.fraction = std::min(1.0, done_ + share_ * now_.step_fraction);
    }
    report_(now_);
  }
  const std::function<void(const ChildProgress&)>& report_;
  std::string text_;
  double done_ = 0, share_ = 0;
  ChildProgress now_;
};

std::string read_up_to(const fs::path& path, std::size_t limit) {
  std::string bytes;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (fd < 0) return bytes;
  char block[65536];
  for (ssize_t n; bytes.size() < limit && (n = ::read(fd, block, sizeof block)) > 0;)
    bytes.append(block, static_cast<std::size_t>(n));
  ::close(fd);
  return bytes;
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  const std::size_t line = text.rfind('\n');
  return line == std::string::npos ? text : text.substr(line + 1);
}

}  // namespace

Result<ChildEnd> run_child(const ChildOrder& order, const std::function<bool()>& cancelled,
                           const std::function<void(const ChildProgress&)>& report) {
  Pipe pipe;
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0)
    return fail(ErrorCode::kInternal, "cannot start job", "progress pipe", std::strerror(errno));
  pipe.read_end = ends[0];
  pipe.write_end = ends[1];
  ::fcntl(pipe.read_end, F_SETFL, O_NONBLOCK);
  GNATHION_TRY(const pid_t pid, spawn(order, pipe));
  pipe.close_write();

  ChildEnd end;
  end.pid = pid;
  ProgressReader reader(report);
  Stopwatch since_term;
  bool open = true, killed = false;
  int status = 0;
  while (true) {
    pollfd wait{open ? pipe.read_end : -1, POLLIN, 0};
    ::poll(&wait, 1, 20);
    char block[4096];
    for (ssize_t n; open && (n = ::read(pipe.read_end, block, sizeof block)) >= 0;) {
      if (n == 0) open = false;
      reader.feed(block, static_cast<std::size_t>(n));
    }
    siginfo_t ended{};
    // The dead leader is left there until its group is gone too: the number cannot be another's meanwhile.
    const int looked = ::waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOHANG | WNOWAIT);
    if (looked == 0 && ended.si_pid == pid) break;
    if (looked != 0 && errno != EINTR)  // its number may be another's by now: no signal any more
      return fail(ErrorCode::kInternal, "cannot follow job", order.program.string(), std::strerror(errno));
    if (!end.cancelled && cancelled()) {
      end.cancelled = true;
      since_term.restart();
      ::kill(-pid, SIGTERM);
    }
    if (end.cancelled && !killed && since_term.seconds() > kGrace_s) {
      killed = true;
      ::kill(-pid, SIGKILL);
    }
  }
  ::kill(-pid, SIGKILL);  // what it may have started itself
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status)) end.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) end.signal = WTERMSIG(status);
  end.output = read_up_to(order.work / "stdout", kMaxOutput);
  end.error = last_line(read_up_to(order.work / "stderr", 1 << 20));
  return end;
}

}  // namespace gnathion::daemon
