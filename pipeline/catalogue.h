// The catalogue of all cases under a root: SQLite in WAL mode. It holds nothing that the folders do not, and
// can be made anew from them; no patient identity.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "pipeline/audit.h"
#include "pipeline/case_folder.h"

namespace gnathion {

struct CatalogueEntry {
  std::string id;
  std::string folder;                                                    ///< relative to the root
  std::string kind, created, verdict, results_at, toml_sha256, problem;  ///< as in CaseSummary
  std::int64_t files = 0, bytes = 0;                                     ///< that case.toml names
};

struct CatalogueQuery {
  std::string id_contains, kind, verdict;  ///< empty: any
  std::int64_t limit = 1000, offset = 0;
};

struct RebuildOutcome {
  std::int64_t cases = 0, with_problems = 0, removed = 0;
};

/// Thread-safe; several processes may have the same file open. Writers wait for one another (10 s).
class Catalogue {
 public:
  /// Made (0600) when it is not there. Refused (kInput): a file that is no catalogue, is damaged, or was
  /// written by a later version; the message says that `--rebuild` makes it anew.
  static Result<Catalogue> open(const std::filesystem::path& file);
  /// Makes it anew from the folders, in one transaction: readers see the old or the new. A damaged file is
  /// replaced; the head records of audit trails are kept where they can be read.
  static Result<RebuildOutcome> rebuild(const std::filesystem::path& file, const std::filesystem::path& root,
                                        CaseTrust trust = CaseTrust::kOwner);
  ~Catalogue();
  Catalogue(Catalogue&&) noexcept;
  Catalogue& operator=(Catalogue&&) = delete;

  Status upsert(const CaseSummary& summary, const std::filesystem::path& root);
  /// Reads the case's folder again: updated, or removed when it is gone.
  Status refresh(const std::string& id, const std::filesystem::path& root,
                 CaseTrust trust = CaseTrust::kOwner);
  Result<std::optional<CatalogueEntry>> find(const std::string& id) const;
  /// Sorted by id.
  Result<std::vector<CatalogueEntry>> query(const CatalogueQuery& query = {}) const;

  /// Head records of audit trails, by the trail's name: they show when a trail's tail was cut off.
  Status set_audit_head(const std::string& trail, const AuditHead& head);
  Result<std::optional<AuditHead>> audit_head(const std::string& trail) const;

 private:
  struct Database;
  static Result<Catalogue> open_or_start_anew(const std::filesystem::path& file);
  explicit Catalogue(std::unique_ptr<Database> database);
  std::unique_ptr<Database> database_;
};

}  // namespace gnathion
