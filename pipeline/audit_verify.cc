#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>

#include "core/file.h"
#include "pipeline/audit.h"
#include "pipeline/audit_line.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMostFaults = 100;

/// Walks the lines in order and says of each what does not fit.
class Walk {
 public:
  void take(std::string_view text, std::uint64_t at) {
    const auto line = audit::parse_line(text);
    if (!line) return unreadable(at);
    if (line->own_hash != line->hash || !line->canonical)
      fault(at, "was changed after it was written: its content does not fit its hash");
    else
      follow(*line, at);
    // The chain goes on from what stands in the line: one fault is named once.
    verdict.head = {line->n, line->hash};
    hashes_[line->n] = line->hash;
    after_unreadable_ = false;
  }

  void compare(const AuditHead& known, const std::string& whose) {
    if (known.lines == 0) return;
    if (known.lines > verdict.head.lines)
      return fault(file_lines, fmt::format("is the last, but {} knows of line {}: {} line{} cut off the end",
                                           whose, known.lines, known.lines - verdict.head.lines,
                                           known.lines - verdict.head.lines == 1 ? " was" : "s were"));
    const auto found = hashes_.find(known.lines);
    if (found == hashes_.end() || found->second != known.sha256)
      fault(known.lines, fmt::format("is not the line that {} knows: the trail was written anew", whose));
  }

  AuditVerdict verdict{AuditHead{0, std::string(64, '0')}, {}, {}};
  std::uint64_t file_lines = 0;

 private:
  void fault(std::uint64_t line, std::string why) {
    if (verdict.faults.size() < kMostFaults) verdict.faults.push_back({line, std::move(why)});
  }

  void unreadable(std::uint64_t at) {
    fault(at, "is no line of an audit trail: it was changed or put in");
    after_unreadable_ = true;
  }

  void follow(const audit::Line& line, std::uint64_t at) {
    const std::uint64_t expected = verdict.head.lines + 1;
    if (line.prev == verdict.head.sha256 && line.n == expected) return;
    if (after_unreadable_ && (line.n == expected || line.n == expected + 1)) return;  // named already
    if (hashes_.count(line.n) != 0 || line.n <= verdict.head.lines)
      fault(at, fmt::format("is out of order or put in: it says it is number {}, after number {}", line.n,
                            verdict.head.lines));
    else if (line.n > expected)
      fault(at, fmt::format("does not follow number {}: {} before it {} removed or moved", verdict.head.lines,
                            line.n - expected == 1 ? fmt::format("number {}", expected)
                                                   : fmt::format("numbers {} to {}", expected, line.n - 1),
                            line.n - expected == 1 ? "was" : "were"));
    else
      fault(at == 1 ? 1 : at - 1,
            fmt::format("was put in or changed with its hash: line {} was written after another one", at));
  }

  std::map<std::uint64_t, std::string> hashes_;
  bool after_unreadable_ = false;
};

/// Where a trail stands at one moment. What is before `whole` never changes again: lines are only added.
struct Snapshot {
  std::uint64_t whole = 0, torn = 0;  ///< bytes up to the last newline, and behind it
  bool has_head = false;
  std::string head;  ///< of the record beside it
};

/// The lock is held for this alone: who writes meanwhile (a capture) does not wait for the hashing.
Result<Snapshot> take_snapshot(int fd, const fs::path& file) {
  constexpr std::uint64_t kTail = 2 * audit::kLongestLine;
  const auto cannot = [&] {
    return bad_input("cannot verify audit trail", file.string(), std::strerror(errno));
  };
  const audit::Lock lock(fd, LOCK_SH);
  struct stat status {};
  if (!lock.held() || ::fstat(fd, &status) != 0) return cannot();
  const auto size = static_cast<std::uint64_t>(status.st_size);
  // A torn end longer than any line is none of ours: it is then walked like a line, and named.
  const std::uint64_t from = size > kTail ? size - kTail : 0;
  std::string tail(size - from, '\0');
  for (std::size_t done = 0; done < tail.size();) {
    const ssize_t n = ::pread(fd, tail.data() + done, tail.size() - done, static_cast<off_t>(from + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return cannot();
    done += static_cast<std::size_t>(n);
  }
  const std::size_t newline = tail.rfind('\n');
  Snapshot s;
  s.torn = newline != std::string::npos ? tail.size() - newline - 1 : from == 0 ? tail.size() : 0;
  s.whole = size - s.torn;
  std::error_code ec;
  s.has_head = fs::exists(audit::head_path(file), ec);
  if (const auto text = s.has_head ? read_file(audit::head_path(file)) : Result<std::string>(std::string()))
    s.head = *text;
  return s;
}

/// The sidecar's word; a line that is newer than it is what a writer leaves that died between the two.
void compare_sidecar(Walk& walk, const Snapshot& then, const fs::path& trail) {
  const std::string name = audit::head_path(trail).filename().string();
  if (!then.has_head) {
    if (walk.verdict.head.lines > 0)
      walk.verdict.faults.push_back({walk.file_lines, "is the last, but the head record " + name +
                                                          " is gone: lines may have been cut off the end"});
    return;
  }
  const auto head = audit::parse_head(then.head);
  if (!head) {
    walk.verdict.faults.push_back({walk.file_lines, "is the last, but the head record cannot be read"});
    return;
  }
  walk.compare(*head, "the head record");
  if (walk.verdict.head.lines == head->lines + 1)
    walk.verdict.notes.push_back("the last line is newer than the head record: its writer died there");
  else if (walk.verdict.head.lines > head->lines + 1)
    walk.verdict.faults.push_back(
        {head->lines + 2,
         fmt::format("and what follows was not written by gnathion: the head record stands at {}",
                     head->lines)});
}

}  // namespace

Result<AuditVerdict> verify_audit(const fs::path& file, const std::vector<AuditHead>& heads) {
  constexpr const char* kWhat = "cannot verify audit trail";
  std::error_code ec;
  if (!fs::is_regular_file(file, ec)) return bad_input(kWhat, file.string(), "is not a file");
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return bad_input(kWhat, file.string(), std::strerror(errno));
  const auto then = take_snapshot(fd, file);
  ::close(fd);
  if (!then) return tl::unexpected<Error>(then.error());
  Walk walk;
  std::ifstream in(file, std::ios::binary);
  std::string line;
  std::uint64_t at = 0;
  for (std::uint64_t read = 0; read < then->whole && std::getline(in, line); read += line.size() + 1)
    walk.take(line, ++at);
  if (then->torn > 0)
    walk.verdict.notes.push_back(
        fmt::format("line {} is torn ({} bytes): its writer died there; the next entry takes it off", at + 1,
                    then->torn));
  walk.file_lines = at;
  for (const AuditHead& head : heads) walk.compare(head, "the catalogue");
  compare_sidecar(walk, *then, file);
  return std::move(walk.verdict);
}

}  // namespace gnathion
