#include "cli/terminal_progress.h"

#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace gnathion {
namespace {

/// -1: none.
int progress_fd() {
  const char* text = std::getenv("GNATHION_PROGRESS_FD");
  return text && *text ? std::atoi(text) : -1;
}

}  // namespace

TerminalProgress::Mode progress_mode(bool quiet) {
  if (progress_fd() > STDERR_FILENO) return TerminalProgress::Mode::kPipe;
  if (quiet || !::isatty(STDERR_FILENO)) return TerminalProgress::Mode::kSilent;
  return TerminalProgress::Mode::kBar;
}

void end_with_the_daemon() {
  if (progress_fd() <= STDERR_FILENO) return;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  // It may have died before that line: then nobody holds the pipe's other end any more, and nobody waits for
  // what this would write into the case.
  pollfd pipe{progress_fd(), POLLOUT, 0};
  if (::poll(&pipe, 1, 0) > 0 && (pipe.revents & POLLERR)) ::_exit(1);
}

TerminalProgress::~TerminalProgress() {
  finish_step();
}

void TerminalProgress::begin_step(std::string_view name, double share) {
  finish_step();
  done_ = std::min(1.0, done_ + share_);
  share_ = share;
  step_ = name;
  last_percent_ = -1;
  step_time_.restart();
  if (mode_ == Mode::kPipe) send(fmt::format("S {:.6f} {}\n", share, name));
  draw(0);
}

/// One write a line, far shorter than PIPE_BUF: lines are never torn. Whoever reads too slowly is not waited
/// for long, because the daemon's pipe holds thousands of them.
void TerminalProgress::send(const std::string& line) const {
  [[maybe_unused]] const ssize_t sent = ::write(progress_fd(), line.data(), line.size());
}

void TerminalProgress::update(double fraction) {
  draw(std::clamp(fraction, 0.0, 1.0));
}

void TerminalProgress::draw(double fraction) {
  if (mode_ == Mode::kSilent || step_.empty()) return;
  const double all = std::min(1.0, done_ + share_ * fraction);
  const int percent = static_cast<int>(100 * all);
  if (percent == last_percent_) return;
  last_percent_ = percent;
  if (mode_ == Mode::kPipe) {
    send(fmt::format("U {:.4f}\n", fraction));
    return;
  }
  constexpr int kWidth = 30;
  const int filled = static_cast<int>(kWidth * all);
  fmt::print(stderr, "\r\033[K[{}{}] {:3d} %  {}", std::string(static_cast<std::size_t>(filled), '#'),
             std::string(static_cast<std::size_t>(kWidth - filled), '.'), percent, step_);
  std::fflush(stderr);
}

void TerminalProgress::finish_step() {
  if (step_.empty()) return;
  if (mode_ == Mode::kBar) fmt::print(stderr, "\r\033[K");
  if (mode_ == Mode::kBar) fmt::print(stderr, "  {:<46} {:6.1f} s\n", step_, step_time_.seconds());
  std::fflush(stderr);
  step_.clear();
}

}  // namespace gnathion
