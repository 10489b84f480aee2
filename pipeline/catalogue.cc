#include "pipeline/catalogue.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>
#include <map>
#include <mutex>

#include "core/check.h"
#include "pipeline/case_private.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr int kBusy_ms = 3'000;
constexpr int kApplicationId = 0x676e6174;  // "gnat"
constexpr int kSchemaVersion = 1;
constexpr const char* kSchema = R"sql(
CREATE TABLE IF NOT EXISTS cases(
  id TEXT NOT NULL, folder TEXT NOT NULL PRIMARY KEY, kind TEXT NOT NULL, created TEXT NOT NULL,
  verdict TEXT NOT NULL, results_at TEXT NOT NULL, toml_sha256 TEXT NOT NULL, problem TEXT NOT NULL,
  files INTEGER NOT NULL, bytes INTEGER NOT NULL) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS cases_by_id ON cases(id);
CREATE TABLE IF NOT EXISTS audit_heads(
  trail TEXT NOT NULL PRIMARY KEY, lines INTEGER NOT NULL, sha256 TEXT NOT NULL) WITHOUT ROWID;
)sql";
constexpr const char* kColumns = "id,folder,kind,created,verdict,results_at,toml_sha256,problem,files,bytes";

}  // namespace

/// One connection. Its statements are made anew for each call: a few dozen microseconds, and no state to
/// keep.
struct Catalogue::Database {
  fs::path path;
  sqlite3* db = nullptr;
  mutable std::recursive_mutex mutex;

  ~Database() { sqlite3_close_v2(db); }

  Error error(const char* what) const {
    const int code = db == nullptr ? SQLITE_NOMEM : sqlite3_errcode(db);
    const std::string why = db == nullptr ? "not enough memory" : sqlite3_errmsg(db);
    if (code == SQLITE_CORRUPT || code == SQLITE_NOTADB)
      return {ErrorCode::kInput, what, path.string(),
              why + "; `gnathion case list ROOT --catalogue FILE --rebuild` makes it anew"};
    return {code == SQLITE_CANTOPEN ? ErrorCode::kInput : ErrorCode::kInternal, what, path.string(), why};
  }

  Status run(const char* sql) const {
    if (sqlite3_exec(db, sql, nullptr, nullptr, nullptr) == SQLITE_OK) return {};
    return tl::unexpected<Error>(error("cannot use catalogue"));
  }

  int number(const char* pragma) const;
};

namespace {

/// A prepared statement with its values.
class Statement {
 public:
  Statement(sqlite3* db, const std::string& sql) {
    if (sqlite3_prepare_v2(db, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK) statement_ = nullptr;
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  explicit operator bool() const { return statement_ != nullptr; }
  Statement& bind(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()), SQLITE_TRANSIENT);
    return *this;
  }
  Statement& bind(std::int64_t number) {
    sqlite3_bind_int64(statement_, ++bound_, number);
    return *this;
  }
  int step() { return sqlite3_step(statement_); }
  std::string text(int column) const {
    const auto* t = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return t == nullptr ? ""
                        : std::string(t, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)));
  }
  std::int64_t integer(int column) const { return sqlite3_column_int64(statement_, column); }

 private:
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

CatalogueEntry entry_of(const Statement& s) {
  return {s.text(0), s.text(1), s.text(2), s.text(3),    s.text(4),
          s.text(5), s.text(6), s.text(7), s.integer(8), s.integer(9)};
}

std::string relative_folder(const fs::path& folder, const fs::path& root) {
  std::error_code ec;
  const fs::path relative =
      fs::weakly_canonical(folder, ec).lexically_relative(fs::weakly_canonical(root, ec));
  return relative.empty() ? folder.generic_string() : relative.generic_string();
}

/// Everything of one transaction or nothing.
class Transaction {
 public:
  explicit Transaction(sqlite3* db) : db_(db) {
    open_ = sqlite3_exec(db_, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr) == SQLITE_OK;
  }
  ~Transaction() {
    if (open_) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  bool begun() const { return open_; }
  bool commit() {
    const bool done = sqlite3_exec(db_, "COMMIT", nullptr, nullptr, nullptr) == SQLITE_OK;
    open_ = !done;
    return done;
  }

 private:
  sqlite3* db_;
  bool open_ = false;
};

}  // namespace

int Catalogue::Database::number(const char* pragma) const {
  Statement s(db, pragma);
  return s && s.step() == SQLITE_ROW ? static_cast<int>(s.integer(0)) : -1;
}

Catalogue::Catalogue(std::unique_ptr<Database> database) : database_(std::move(database)) {}
Catalogue::~Catalogue() = default;
Catalogue::Catalogue(Catalogue&&) noexcept = default;

Result<Catalogue> Catalogue::open(const fs::path& file) {
  constexpr const char* kWhat = "cannot open catalogue";
  auto d = std::make_unique<Database>();
  d->path = file;
  // Made here with its mode: SQLite gives its -wal and -shm files the mode of the file itself.
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600);
  if (fd < 0) return bad_input(kWhat, file.string(), std::strerror(errno));
  ::close(fd);
  if (sqlite3_open_v2(file.c_str(), &d->db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_FULLMUTEX, nullptr) !=
      SQLITE_OK)
    return tl::unexpected<Error>(d->error(kWhat));
  sqlite3_busy_timeout(d->db, kBusy_ms);
  const int id = d->number("PRAGMA application_id"), version = d->number("PRAGMA user_version");
  if (id < 0) return tl::unexpected<Error>(d->error(kWhat));
  const int tables = d->number("SELECT count(*) FROM sqlite_master");
  if (tables > 0 && id != kApplicationId)
    return bad_input(kWhat, file.string(), "is a database of something else");
  if (version > kSchemaVersion)
    return bad_input(kWhat, file.string(), "was written by a later version of gnathion");
  GNATHION_CHECK_OK(d->run("PRAGMA journal_mode=WAL"));
  GNATHION_CHECK_OK(d->run("PRAGMA synchronous=FULL"));
  if (tables > 0 && version == kSchemaVersion) return Catalogue(std::move(d));
  Transaction t(d->db);
  if (!t.begun()) return tl::unexpected<Error>(d->error(kWhat));
  GNATHION_CHECK_OK(d->run(kSchema));
  GNATHION_CHECK_OK(
      d->run(fmt::format("PRAGMA application_id={}; PRAGMA user_version={}", kApplicationId, kSchemaVersion)
                 .c_str()));
  if (!t.commit()) return tl::unexpected<Error>(d->error(kWhat));
  return Catalogue(std::move(d));
}

Status Catalogue::upsert(const CaseSummary& s, const fs::path& root) {
  const std::scoped_lock lock(database_->mutex);
  std::uint64_t bytes = 0;
  for (const CaseFileEntry& f : s.files) bytes += f.bytes;
  Statement st(database_->db,
               fmt::format("INSERT OR REPLACE INTO cases({}) VALUES(?,?,?,?,?,?,?,?,?,?)", kColumns));
  if (!st) return tl::unexpected<Error>(database_->error("cannot write catalogue"));
  st.bind(s.id).bind(relative_folder(s.folder, root)).bind(s.kind).bind(s.created).bind(s.verdict);
  st.bind(s.results_at).bind(s.toml_sha256).bind(s.problem);
  st.bind(static_cast<std::int64_t>(s.files.size())).bind(static_cast<std::int64_t>(bytes));
  if (st.step() != SQLITE_DONE) return tl::unexpected<Error>(database_->error("cannot write catalogue"));
  return {};
}

Status Catalogue::refresh(const std::string& id, const fs::path& root, CaseTrust trust) {
  GNATHION_CHECK_OK(check_case_id(id));
  std::error_code ec;
  if (fs::exists(root / id / "case.toml", ec)) return upsert(summarize_case(root / id, trust), root);
  const std::scoped_lock lock(database_->mutex);
  Statement st(database_->db, "DELETE FROM cases WHERE folder=?");
  if (!st || st.bind(id).step() != SQLITE_DONE)
    return tl::unexpected<Error>(database_->error("cannot write catalogue"));
  return {};
}

Result<std::optional<CatalogueEntry>> Catalogue::find(const std::string& id) const {
  const std::scoped_lock lock(database_->mutex);
  Statement st(database_->db,
               fmt::format("SELECT {} FROM cases WHERE id=? ORDER BY folder LIMIT 1", kColumns));
  if (!st) return tl::unexpected<Error>(database_->error("cannot read catalogue"));
  const int step = st.bind(id).step();
  if (step == SQLITE_ROW) return std::optional(entry_of(st));
  if (step == SQLITE_DONE) return std::optional<CatalogueEntry>();
  return tl::unexpected<Error>(database_->error("cannot read catalogue"));
}

Result<std::vector<CatalogueEntry>> Catalogue::query(const CatalogueQuery& q) const {
  const std::scoped_lock lock(database_->mutex);
  Statement st(database_->db,
               fmt::format("SELECT {} FROM cases WHERE (?1='' OR instr(id,?1)>0) AND (?2='' OR kind=?2) AND "
                           "(?3='' OR verdict=?3) ORDER BY id,folder LIMIT ?4 OFFSET ?5",
                           kColumns));
  if (!st) return tl::unexpected<Error>(database_->error("cannot read catalogue"));
  st.bind(q.id_contains).bind(q.kind).bind(q.verdict).bind(std::max<std::int64_t>(q.limit, 0));
  st.bind(std::max<std::int64_t>(q.offset, 0));
  std::vector<CatalogueEntry> all;
  int step = st.step();
  for (; step == SQLITE_ROW; step = st.step()) all.push_back(entry_of(st));
  if (step != SQLITE_DONE) return tl::unexpected<Error>(database_->error("cannot read catalogue"));
  return all;
}

Status Catalogue::set_audit_head(const std::string& trail, const AuditHead& head) {
  const std::scoped_lock lock(database_->mutex);
  // Two writers may come in the other order than their lines: the later line stands.
  Statement st(
      database_->db,
      "INSERT INTO audit_heads(trail,lines,sha256) VALUES(?1,?2,?3) ON CONFLICT(trail) DO UPDATE SET "
      "lines=?2,sha256=?3 WHERE ?2>lines");
  if (!st ||
      st.bind(trail).bind(static_cast<std::int64_t>(head.lines)).bind(head.sha256).step() != SQLITE_DONE)
    return tl::unexpected<Error>(database_->error("cannot write catalogue"));
  return {};
}

Result<std::optional<AuditHead>> Catalogue::audit_head(const std::string& trail) const {
  const std::scoped_lock lock(database_->mutex);
  Statement st(database_->db, "SELECT lines,sha256 FROM audit_heads WHERE trail=?");
  if (!st) return tl::unexpected<Error>(database_->error("cannot read catalogue"));
  const int step = st.bind(trail).step();
  if (step == SQLITE_ROW)
    return std::optional(AuditHead{static_cast<std::uint64_t>(st.integer(0)), st.text(1)});
  if (step == SQLITE_DONE) return std::optional<AuditHead>();
  return tl::unexpected<Error>(database_->error("cannot read catalogue"));
}

Result<Catalogue> Catalogue::open_or_start_anew(const fs::path& file) {
  std::map<std::string, AuditHead> heads;
  {
    Result<Catalogue> opened = open(file);
    if (opened) {
      Database& d = *opened->database_;
      Statement check(d.db, "PRAGMA quick_check(1)");
      if (check && check.step() == SQLITE_ROW && check.text(0) == "ok") return opened;
      Statement st(d.db, "SELECT trail,lines,sha256 FROM audit_heads");
      while (st && st.step() == SQLITE_ROW)
        heads[st.text(0)] = {static_cast<std::uint64_t>(st.integer(1)), st.text(2)};
    } else if (opened.error().why.find("--rebuild") == std::string::npos) {
      return opened;  // not there, or of somebody else: nothing to replace
    }
  }
  // Damaged: put aside, not deleted.
  std::error_code ec;
  fs::rename(file, file.string() + ".damaged", ec);
  if (ec) return fail(ErrorCode::kInternal, "cannot rebuild catalogue", file.string(), ec.message());
  for (const char* suffix : {"-wal", "-shm"}) fs::remove(file.string() + suffix, ec);
  GNATHION_TRY(Catalogue fresh, open(file));
  for (const auto& [trail, head] : heads) GNATHION_CHECK_OK(fresh.set_audit_head(trail, head));
  return fresh;
}

Result<RebuildOutcome> Catalogue::rebuild(const fs::path& file, const fs::path& root, CaseTrust trust) {
  GNATHION_TRY(const std::vector<CaseSummary> cases, list_cases(root, trust));
  GNATHION_TRY(Catalogue fresh, open_or_start_anew(file));
  Database& d = *fresh.database_;
  const std::scoped_lock lock(d.mutex);
  Transaction t(d.db);
  if (!t.begun()) return tl::unexpected<Error>(d.error("cannot rebuild catalogue"));
  RebuildOutcome outcome;
  const int before = d.number("SELECT count(*) FROM cases");
  GNATHION_CHECK_OK(d.run("CREATE TEMP TABLE seen AS SELECT folder FROM cases; DELETE FROM cases"));
  for (const CaseSummary& s : cases) {
    GNATHION_CHECK_OK(fresh.upsert(s, root));
    ++outcome.cases;
    outcome.with_problems += s.problem.empty() ? 0 : 1;
  }
  const int kept = d.number("SELECT count(*) FROM seen WHERE folder IN (SELECT folder FROM cases)");
  outcome.removed = before - kept;
  GNATHION_CHECK_OK(d.run("DROP TABLE seen"));
  if (!t.commit()) return tl::unexpected<Error>(d.error("cannot rebuild catalogue"));
  return outcome;
}

}  // namespace gnathion
