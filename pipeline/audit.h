// Who did what, when: an append-only file of JSON lines, each with the hash of the one before.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/time.h"

namespace gnathion {

/// Where a trail stands: its number of lines and the hash of the last. Kept apart from the trail it shows
/// that lines were cut off its end.
struct AuditHead {
  std::uint64_t lines = 0;
  std::string sha256;  ///< of no line: 64 zeros
};

struct AuditEntry {
  std::string who;      ///< "uid 1000 (anna) pid 4711", never the patient
  std::string what;     ///< "case.create", "capture.start"
  std::string case_id;  ///< empty: of no case
  std::string details;  ///< one line for people, at most 4096 bytes; longer is cut and marked
};

/// Appends to one trail. Thread-safe, and safe against other processes that append to the same file (flock).
class AuditTrail {
 public:
  /// Made (0600, with FILE.head beside it) when it is not there. Refused (kInput): a file that is no trail,
  /// or whose last line does not fit its head record.
  static Result<AuditTrail> open(const std::filesystem::path& file);
  ~AuditTrail();
  AuditTrail(AuditTrail&&) noexcept;
  AuditTrail& operator=(AuditTrail&&) = delete;

  /// On disk (fsync) when it returns. A torn last line that a crash left is taken off first, and a line
  /// "audit.recovered" with its bytes says so.
  Result<AuditHead> append(const AuditEntry& entry, HostTime time);

 private:
  struct File;
  explicit AuditTrail(std::unique_ptr<File> file);
  std::unique_ptr<File> file_;
};

struct AuditFault {
  std::uint64_t line = 0;  ///< in the file, from 1
  std::string why;         ///< "was changed after it was written", "2 lines before it were removed"
};

struct AuditVerdict {
  AuditHead head;                  ///< of the last line that is whole
  std::vector<AuditFault> faults;  ///< at most 100
  std::vector<std::string> notes;  ///< what a crash explains: a torn last line, a head one line behind
  bool good() const { return faults.empty(); }
};

/// Reads the trail as it stands when this is called; who appends meanwhile does not wait. `heads` are what else is known of where it stood (the catalogue's);
/// FILE.head is always taken too. Refused (kInput): a file that cannot be read.
Result<AuditVerdict> verify_audit(const std::filesystem::path& file,
                                  const std::vector<AuditHead>& heads = {});

}  // namespace gnathion
