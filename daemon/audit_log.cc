#include "daemon/audit_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/log.h"

namespace gnathion::daemon {
namespace {

constexpr const char* kTrail = "audit.jsonl";
/// The catalogue's head is a second witness; it need not see every line at once.
constexpr double kTell_s = 2;

}  // namespace

void AuditLog::note(const std::string& who, const std::string& what, const std::string& case_id,
                    const std::string& details) {
  const HostTime now = clock_.now();
  const auto head = trail_.append({who, what, case_id, details}, now);
  if (!head) {
    log(LogLevel::kError,
        fmt::format("audit: {} by {} is not in the trail: {}", what, who, head.error().line()));
    std::lock_guard lock(mutex_);
    ++lost_;
    why_ = head.error().line();
    return;
  }
  std::lock_guard lock(mutex_);
  if (!untold_ || untold_->lines < head->lines) untold_ = *head;
  if (now.seconds_since(told_) < kTell_s) return;
  told_ = now;
  if (const Status kept = catalogue_.set_audit_head(kTrail, *untold_); !kept)
    log(LogLevel::kError, "audit: " + kept.error().line());
}

std::string AuditLog::fault() const {
  std::lock_guard lock(mutex_);
  return lost_ == 0 ? ""
                    : fmt::format("audit trail: {} lines could not be written since the start; the last: {}",
                                  lost_, why_);
}

AuditLog::~AuditLog() {
  if (untold_) (void)catalogue_.set_audit_head(kTrail, *untold_);
}

Result<std::vector<AuditRow>> last_audit_rows(const std::filesystem::path& trail, const std::string& case_id,
                                              std::size_t limit) {
  std::ifstream in(trail);
  if (!in) return bad_input("cannot read audit trail", trail.string(), "cannot be opened");
  std::deque<AuditRow> rows;
  for (std::string line; std::getline(in, line);) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object()) continue;
    const auto text = [&](const char* key) { return json.value(key, std::string()); };
    if (!case_id.empty() && text("case") != case_id) continue;
    rows.push_back({json.value("n", std::uint64_t{0}), text("time"), text("who"), text("what"), text("case"),
                    text("details")});
    if (rows.size() > limit) rows.pop_front();
  }
  return std::vector<AuditRow>(rows.begin(), rows.end());
}

}  // namespace gnathion::daemon
