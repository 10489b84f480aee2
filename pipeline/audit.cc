#include "pipeline/audit.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/utc.h"
#include "core/xml.h"
#include "pipeline/audit_line.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot append to audit trail";
constexpr std::size_t kLongestField = 256, kLongestDetails = 4096;

std::string errno_text() {
  return std::strerror(errno);
}

/// Cut at a limit, marked, valid UTF-8.
std::string bounded(std::string_view text, std::size_t limit) {
  if (text.size() <= limit) return valid_utf8(text);
  return valid_utf8(text.substr(0, limit)) + fmt::format(" [cut, {} bytes]", text.size());
}

Status write_all(int fd, std::string_view bytes, const std::string& where) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return fail(ErrorCode::kInternal, kWhat, where, n < 0 ? errno_text() : "no room");
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return {};
}

}  // namespace

namespace audit {

Lock::Lock(int fd, int how) : fd_(fd) {
  int r = 0;
  do r = ::flock(fd_, how);
  while (r != 0 && errno == EINTR);
  held_ = r == 0;
}
Lock::~Lock() {
  if (held_) ::flock(fd_, LOCK_UN);
}

fs::path head_path(const fs::path& trail) {
  return fs::path(trail.string() + ".head");
}

std::string hash_of(json line) {
  line.erase("hash");
  return sha256_hex(line.dump());
}

std::optional<AuditHead> parse_head(const std::string& text) {
  const json j = json::parse(text, nullptr, false);
  if (!j.is_object() || !j.contains("lines") || !j["lines"].is_number_unsigned() || !j.contains("sha256") ||
      !j["sha256"].is_string() || j["sha256"].get_ref<const std::string&>().size() != 64)
    return std::nullopt;
  return AuditHead{j["lines"].get<std::uint64_t>(), j["sha256"].get<std::string>()};
}

std::optional<Line> parse_line(std::string_view text) {
  const json j = json::parse(text, nullptr, false);
  if (!j.is_object()) return std::nullopt;
  for (const char* key : {"hash", "prev", "time", "who", "what"})
    if (!j.contains(key) || !j[key].is_string()) return std::nullopt;
  if (!j.contains("n") || !j["n"].is_number_unsigned()) return std::nullopt;
  Line line;
  line.n = j["n"].get<std::uint64_t>();
  line.prev = j["prev"].get<std::string>();
  line.hash = j["hash"].get<std::string>();
  line.own_hash = hash_of(j);
  // A second key of the same name, other spacing or order would be a change that the hash does not see.
  line.canonical = j.dump() == text;
  return line;
}

}  // namespace audit

struct AuditTrail::File {
  fs::path path;
  int fd = -1;
  std::mutex mutex;

  ~File() {
    if (fd >= 0) ::close(fd);
  }

  Result<std::string> tail(std::uint64_t from, std::uint64_t to) const {
    std::string bytes(to - from, '\0');
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t n =
          ::pread(fd, bytes.data() + done, bytes.size() - done, static_cast<off_t>(from + done));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return fail(ErrorCode::kInternal, kWhat, path.string(), n < 0 ? errno_text() : "was cut");
      done += static_cast<std::size_t>(n);
    }
    return bytes;
  }

  /// The last whole line, and where the torn rest behind it starts.
  struct End {
    AuditHead head{0, std::string(64, '0')};
    std::uint64_t whole = 0, size = 0;
    std::string torn;
  };
  Result<End> find_end() const {
    struct stat status {};
    if (::fstat(fd, &status) != 0) return fail(ErrorCode::kInternal, kWhat, path.string(), errno_text());
    End end;
    end.size = static_cast<std::uint64_t>(status.st_size);
    // Two longest lines hold the last whole one, whatever was torn behind it.
    const std::uint64_t from = end.size > 2 * audit::kLongestLine ? end.size - 2 * audit::kLongestLine : 0;
    GNATHION_TRY(const std::string bytes, tail(from, end.size));
    const std::size_t newline = bytes.rfind('\n');
    if (newline == std::string::npos) {
      if (from > 0) return bad_input(kWhat, path.string(), "is no audit trail: its last line is too long");
      end.torn = bytes;
      return end;
    }
    end.torn = bytes.substr(newline + 1);
    end.whole = end.size - end.torn.size();
    const std::size_t start = newline == 0 ? std::string::npos : bytes.rfind('\n', newline - 1);
    const std::size_t first = start == std::string::npos ? 0 : start + 1;
    const auto line = audit::parse_line(std::string_view(bytes).substr(first, newline - first));
    if (!line || line->own_hash != line->hash)
      return bad_input(kWhat, path.string(),
                       "its last line is not one of an audit trail; `gnathion audit verify` tells more");
    end.head = {line->n, line->hash};
    return end;
  }

  Status write_head(const AuditHead& head) const {
    const json record = {{"lines", head.lines}, {"sha256", head.sha256}};
    GNATHION_CHECK_OK(write_file(audit::head_path(path), record.dump() + "\n"));
    ::chmod(audit::head_path(path).c_str(), 0600);
    return {};
  }

  /// The head record may be behind by the one line whose writer died between the two; it is brought up first,
  /// so that it is never behind by more.
  Status check_head(const AuditHead& head) const {
    std::error_code ec;
    if (!fs::exists(audit::head_path(path), ec)) {
      if (head.lines == 0) return write_head(head);  // a new trail
      return bad_input(kWhat, path.string(),
                       "its head record " + audit::head_path(path).filename().string() +
                           " is gone; `gnathion audit verify` tells what still stands");
    }
    GNATHION_TRY(const std::string text, read_file(audit::head_path(path)));
    const auto recorded = audit::parse_head(text);
    if (!recorded) return bad_input(kWhat, path.string(), "its head record cannot be read");
    if (recorded->lines == head.lines && recorded->sha256 == head.sha256) return {};
    if (head.lines == recorded->lines + 1) return write_head(head);
    return bad_input(kWhat, path.string(),
                     fmt::format("ends at line {}, its head record says {}: lines were cut off or changed; "
                                 "`gnathion audit verify` tells more",
                                 head.lines, recorded->lines));
  }

  Result<AuditHead> write_line(const AuditHead& head, const json& content) const {
    json line = content;
    line["n"] = head.lines + 1;
    line["prev"] = head.sha256;
    line["hash"] = audit::hash_of(line);
    GNATHION_CHECK_OK(write_all(fd, line.dump() + "\n", path.string()));
    if (::fsync(fd) != 0) return fail(ErrorCode::kInternal, kWhat, path.string(), errno_text());
    const AuditHead now{head.lines + 1, line["hash"].get<std::string>()};
    GNATHION_CHECK_OK(write_head(now));
    return now;
  }

  /// Takes off what a crash left behind the last whole line, and says so in a line of its own.
  Result<AuditHead> recover(const End& end, const std::string& time) const {
    if (end.torn.empty()) return end.head;
    if (::ftruncate(fd, static_cast<off_t>(end.whole)) != 0)
      return fail(ErrorCode::kInternal, kWhat, path.string(), errno_text());
    return write_line(
        end.head, {{"time", time},
                   {"who", "gnathion"},
                   {"what", "audit.recovered"},
                   {"case", ""},
                   {"details", fmt::format("a torn last line of {} bytes, SHA-256 {}, was taken off: {}",
                                           end.torn.size(), sha256_hex(end.torn), bounded(end.torn, 512))}});
  }
};

AuditTrail::AuditTrail(std::unique_ptr<File> file) : file_(std::move(file)) {}
AuditTrail::~AuditTrail() = default;
AuditTrail::AuditTrail(AuditTrail&&) noexcept = default;

Result<AuditTrail> AuditTrail::open(const fs::path& path) {
  auto file = std::make_unique<File>();
  file->path = path;
  file->fd = ::open(path.c_str(), O_RDWR | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600);
  if (file->fd < 0) return bad_input("cannot open audit trail", path.string(), errno_text());
  struct stat status {};
  if (::fstat(file->fd, &status) != 0 || !S_ISREG(status.st_mode))
    return bad_input("cannot open audit trail", path.string(), "is not a file");
  const audit::Lock lock(file->fd, LOCK_EX);
  if (!lock.held()) return fail(ErrorCode::kInternal, kWhat, path.string(), "cannot be locked");
  GNATHION_TRY(const File::End end, file->find_end());
  GNATHION_CHECK_OK(file->check_head(end.head));
  return AuditTrail(std::move(file));
}

Result<AuditHead> AuditTrail::append(const AuditEntry& entry, HostTime time) {
  const std::scoped_lock mine(file_->mutex);
  const audit::Lock lock(file_->fd, LOCK_EX);
  if (!lock.held()) return fail(ErrorCode::kInternal, kWhat, file_->path.string(), "cannot be locked");
  GNATHION_TRY(const File::End end, file_->find_end());
  GNATHION_CHECK_OK(file_->check_head(end.head));
  const std::string text = fmt::format("{}.{:09}Z", utc_text(time).substr(0, 19),
                                       std::max<std::int64_t>(time.ns, 0) % 1'000'000'000);
  GNATHION_TRY(const AuditHead head, file_->recover(end, text));
  const off_t before = ::lseek(file_->fd, 0, SEEK_END);
  const auto written = file_->write_line(head, {{"time", text},
                                                {"who", bounded(entry.who, kLongestField)},
                                                {"what", bounded(entry.what, kLongestField)},
                                                {"case", bounded(entry.case_id, kLongestField)},
                                                {"details", bounded(entry.details, kLongestDetails)}});
  // A line that did not go out whole (full disk) must not stay as a torn one: nothing crashed here.
  if (!written && before >= 0) (void)!::ftruncate(file_->fd, before);
  return written;
}

}  // namespace gnathion
