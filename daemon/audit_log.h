// The audit trail as the daemon keeps it, with its head in the catalogue too.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/time.h"
#include "pipeline/audit.h"
#include "pipeline/catalogue.h"

namespace gnathion::daemon {

/// Thread-safe. A line that cannot be written is told in the log and by fault(); the work goes on: a
/// recording must be stoppable on a full disk.
class AuditLog {
 public:
  AuditLog(AuditTrail trail, Catalogue& catalogue, Clock& clock)
      : trail_(std::move(trail)), catalogue_(catalogue), clock_(clock) {}
  ~AuditLog();
  void note(const std::string& who, const std::string& what, const std::string& case_id = {},
            const std::string& details = {});
  /// Lines that are missing from the trail since the daemon's start, with the last reason; empty: none.
  std::string fault() const;

 private:
  AuditTrail trail_;
  Catalogue& catalogue_;
  Clock& clock_;
  mutable std::mutex mutex_;  ///< of what follows
  std::uint64_t lost_ = 0;
  std::string why_;
  std::optional<AuditHead> untold_;
  HostTime told_;
};

/// One line of the trail, for showing.
struct AuditRow {
  std::uint64_t number = 0;
  std::string time, who, what, case_id, details;
};
/// The last `limit` lines of a case (empty: of all), oldest first.
Result<std::vector<AuditRow>> last_audit_rows(const std::filesystem::path& trail, const std::string& case_id,
                                              std::size_t limit);

}  // namespace gnathion::daemon
