#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

#include "core/log.h"
#include "daemon/case_listing.h"
#include "daemon/client_path.h"
#include "daemon/services/support.h"
#include "gnathion/v1/cases.grpc.pb.h"
#include "pipeline/case_folder.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kChunk = 256 << 10;
constexpr std::chrono::seconds kUploadStall{30};
constexpr int kUploadStalls = 30;  ///< as many of these at most: a quarter of an hour for a whole upload

void fill(api::CaseInfo& to, const CaseListing& from) {
  to.set_case_id(from.id);
  to.set_kind(from.kind);
  to.set_problem(from.problem);
  to.set_modified_ns(from.modified.ns);
  for (const ListedFile& file : from.files) {
    api::CaseFileInfo& f = *to.add_file();
    f.set_path(file.path);
    f.set_role(file.role);
    f.set_bytes(file.bytes);
    f.set_modified_ns(file.modified.ns);
  }
}

void fill(api::CaseInfo& to, const CatalogueEntry& from) {
  to.set_case_id(from.id);
  to.set_kind(from.kind);
  to.set_problem(from.problem);
}

ImportOrder order_of(const api::ImportCaseRequest& request) {
  return {request.case_id(), {request.role().begin(), request.role().end()}, request.trust_names()};
}

/// Ends a call whose client sends nothing for too long, or goes on for `most` times as long: it would keep
/// others from their turn.
class StallGuard {
 public:
  StallGuard(grpc::ServerContext& call, std::chrono::seconds limit, int most)
      : watcher_([this, &call, limit, most] {
          std::unique_lock lock(mutex_);
          for (int period = 1;; ++period) {
            const std::uint64_t seen = rounds_;
            if (changed_.wait_for(lock, limit, [&] { return over_; })) return;
            if (rounds_ == seen || period == most) return call.TryCancel();
          }
        }) {}
  ~StallGuard() {
    {
      std::lock_guard lock(mutex_);
      over_ = true;
    }
    changed_.notify_all();
    watcher_.join();
  }
  void goes_on() {
    std::lock_guard lock(mutex_);
    ++rounds_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool over_ = false;
  std::uint64_t rounds_ = 0;
  std::thread watcher_;
};

class CasesService : public api::Cases::Service {
 public:
  explicit CasesService(ServiceContext& context) : context_(context) {}

  grpc::Status Create(grpc::ServerContext* call, const api::CreateCaseRequest* request,
                      api::CaseInfo* response) override {
    NewCase what;
    what.id = request->case_id().empty() ? made_case_id(context_.clock) : request->case_id();
    what.kind = request->kind().empty() ? "patient" : request->kind();
    if (what.kind != "patient" && what.kind != "phantom")
      return to_grpc({ApiCode::kInvalidArgument, "a case's kind is 'patient' or 'phantom'"});
    if (const Status id = check_case_id(what.id); !id) return to_grpc(refuse(id.error()).value());
    const auto folder = context_.root.case_folder(what.id, PathUse::kNew);
    if (!folder) return to_grpc(refuse(folder.error()).value());
    std::error_code ec;
    if (fs::exists(*folder, ec))
      return to_grpc(
          {ApiCode::kAlreadyExists, fmt::format("the case '{}' exists: choose another id", what.id)});
    if (const auto made = create_case(*folder, what, context_.clock); !made)
      return to_grpc(refuse(made.error()).value());
    refresh(what.id);
    context_.audit.note(context_.who(*call), "case.create", what.id, what.kind);
    fill(*response, list_case(*folder));
    return grpc::Status::OK;
  }

  grpc::Status List(grpc::ServerContext*, const api::ListCasesRequest* request,
                    api::ListCasesResponse* response) override {
    const int limit = request->limit() == 0 ? 100 : static_cast<int>(std::min(request->limit(), 1000u));
    CatalogueQuery query;
    query.limit = std::numeric_limits<std::int32_t>::max();
    const auto entries = context_.catalogue.query(query);
    if (!entries) return to_grpc(refuse(entries.error()).value());
    for (const CatalogueEntry& entry : *entries) {
      if (entry.id <= request->after() && !request->after().empty()) continue;
      if (response->case__size() == limit) {
        response->set_more(true);
        break;
      }
      fill(*response->add_case_(), entry);
    }
    return grpc::Status::OK;
  }

  grpc::Status Open(grpc::ServerContext* call, const api::OpenCaseRequest* request,
                    api::CaseInfo* response) override {
    const auto folder = case_folder(request->case_id());
    if (!folder) return refused(context_, *call, "case.open", {}, folder.error());
    fill(*response, list_case(*folder));
    refresh(request->case_id());
    context_.audit.note(context_.who(*call), "case.open", request->case_id());
    return grpc::Status::OK;
  }

  grpc::Status ReadFile(grpc::ServerContext* call, const api::ReadFileRequest* request,
                        grpc::ServerWriter<api::FileChunk>* writer) override {
    auto slot = context_.streams.take();
    if (!slot) return to_grpc(slot.error());
    const auto folder = case_folder(request->case_id());
    if (!folder) return to_grpc(folder.error());
    const auto path = path_in_case(context_.root, *folder, request->path(), PathUse::kExisting);
    if (!path) return refused(context_, *call, "case.read", request->case_id(), path.error());
    if (may_hold_identity(*path))
      return refused(
          context_, *call, "case.read", request->case_id(),
          {ApiCode::kPermissionDenied, "case.toml holds the patient's identity and is not given out"});
    const int fd = ::open(path->c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    struct stat info {};
    if (fd < 0 || ::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
      if (fd >= 0) ::close(fd);
      return to_grpc({ApiCode::kInvalidArgument, fmt::format("'{}' is no file", request->path())});
    }
    context_.audit.note(context_.who(*call), "case.read", request->case_id(), request->path());
    const grpc::Status sent = send(fd, static_cast<std::uint64_t>(info.st_size), *call, writer);
    ::close(fd);
    return sent;
  }

  grpc::Status Import(grpc::ServerContext* call, const api::ImportCaseRequest* request,
                      api::CaseInfo* response) override;
  grpc::Status ImportFiles(grpc::ServerContext* call, grpc::ServerReader<api::ImportChunk>* reader,
                           api::CaseInfo* response) override;

 private:
  ApiStatus may_import() const;
  grpc::Status import(grpc::ServerContext& call, const fs::path& source, const ImportOrder& order,
                      const std::string& detail, api::CaseInfo* response);

  ApiResult<fs::path> case_folder(const std::string& id) {
    const auto folder = context_.root.case_folder(id);
    if (folder) return *folder;
    const ApiCode code = check_case_id(id) ? ApiCode::kNotFound : ApiCode::kInvalidArgument;
    return refuse(code, folder.error().line() + "; `gnathion cases` lists them");
  }

  void refresh(const std::string& id) {
    if (const Status done = context_.catalogue.refresh(id, context_.root.path(), CaseTrust::kConfined); !done)
      log(LogLevel::kWarning, "catalogue: " + done.error().line());
  }

  grpc::Status send(int fd, std::uint64_t total, grpc::ServerContext& call,
                    grpc::ServerWriter<api::FileChunk>* writer) {
    api::FileChunk chunk;
    std::string block(kChunk, '\0');
    std::uint64_t offset = 0;
    do {
      const ssize_t n = ::pread(fd, block.data(), block.size(), static_cast<off_t>(offset));
      if (n < 0) return to_grpc({ApiCode::kInternal, std::string("cannot read: ") + std::strerror(errno)});
      chunk.set_offset(offset);
      chunk.set_total_bytes(total);
      chunk.set_data(block.data(), static_cast<std::size_t>(n));
      if (!writer->Write(chunk)) break;
      offset += static_cast<std::uint64_t>(n);
      if (n == 0 && offset < total)
        return to_grpc({ApiCode::kInternal, "the file became shorter: read it again"});
    } while (offset < total && !call.IsCancelled() && !context_.going_down);
    return grpc::Status::OK;
  }

  ServiceContext& context_;
};

ApiStatus CasesService::may_import() const {
  const State state = context_.session.view().state;
  if (state == State::kRecording || state == State::kStopping)
    return refuse(ApiCode::kFailedPrecondition,
                  "a recording is running, and the disk is its: import when it has ended");
  return {};
}

grpc::Status CasesService::Import(grpc::ServerContext* call, const api::ImportCaseRequest* request,
                                  api::CaseInfo* response) {
  if (const ApiStatus may = may_import(); !may) return to_grpc(may.error());
  const fs::path incoming = context_.root.path() / "incoming";
  std::error_code ec;
  fs::create_directory(incoming, ec);
  const auto source = path_in_case(context_.root, incoming, request->source(), PathUse::kExisting);
  if (!source) return refused(context_, *call, "case.import", {}, source.error());
  // The file's own name may be a person's: the trail cannot be cleaned.
  return import(*call, *source, order_of(*request), fs::path(request->source()).extension(), response);
}

grpc::Status CasesService::import(grpc::ServerContext& call, const fs::path& source, const ImportOrder& order,
                                  const std::string& detail, api::CaseInfo* response) {
  const auto made = context_.importer.import(
      source, order, [&] { return call.IsCancelled() || context_.going_down.load(); });
  if (!made) return to_grpc(made.error());
  refresh(*made);
  context_.audit.note(context_.who(call), "case.import", *made, detail);
  fill(*response, list_case(context_.root.path() / *made));
  return grpc::Status::OK;
}

grpc::Status CasesService::ImportFiles(grpc::ServerContext* call,
                                       grpc::ServerReader<api::ImportChunk>* reader,
                                       api::CaseInfo* response) {
  auto slot = context_.streams.take();
  if (!slot) return to_grpc(slot.error());
  auto upload = context_.importer.upload();
  if (!upload) return to_grpc(upload.error());
  api::ImportChunk chunk;
  std::optional<api::ImportCaseRequest> options;
  {
    StallGuard guard(*call, kUploadStall, kUploadStalls);
    while (reader->Read(&chunk)) {
      if (!chunk.name().empty() || !chunk.data().empty()) guard.goes_on();
      if (chunk.has_options() && !options) options = chunk.options();
      if (const ApiStatus may = may_import(); !may) return to_grpc(may.error());
      if (!chunk.name().empty())
        if (const ApiStatus begun = (*upload)->begin_file(chunk.name()); !begun)
          return refused(context_, *call, "case.import", {}, begun.error());
      if (const ApiStatus taken = (*upload)->write(chunk.data()); !taken) return to_grpc(taken.error());
    }
  }
  if (call->IsCancelled())
    return {grpc::StatusCode::CANCELLED, "the files did not come whole: send them again"};
  if (!options) return to_grpc({ApiCode::kInvalidArgument, "the first message must hold the options"});
  const auto source = (*upload)->finish(options->source());
  if (!source) return to_grpc(source.error());
  return import(*call, *source, order_of(*options),
                fmt::format("{} files, {} bytes", (*upload)->files(), (*upload)->bytes()), response);
}

class CatalogueService : public api::Catalogue::Service {
 public:
  explicit CatalogueService(ServiceContext& context) : context_(context) {}

  grpc::Status Search(grpc::ServerContext*, const api::SearchRequest* request,
                      api::SearchResponse* response) override {
    CatalogueQuery query;
    query.id_contains = request->text();
    query.limit = request->limit() == 0 ? 100 : std::min(request->limit(), 1000u);
    const auto entries = context_.catalogue.query(query);
    if (!entries) return to_grpc(refuse(entries.error()).value());
    for (const CatalogueEntry& entry : *entries) fill(*response->add_case_(), entry);
    return grpc::Status::OK;
  }

  grpc::Status Rebuild(grpc::ServerContext* call, const api::RebuildRequest*,
                       api::RebuildResponse* response) override {
    const auto cases = list_cases(context_.root.path(), CaseTrust::kConfined);
    if (!cases) return to_grpc(refuse(cases.error()).value());
    for (const CaseSummary& summary : *cases) {
      if (const Status kept = context_.catalogue.upsert(summary, context_.root.path()); !kept)
        return to_grpc(refuse(kept.error()).value());
      if (!summary.problem.empty()) response->add_problem(summary.id + ": " + summary.problem);
    }
    response->set_cases(cases->size());
    context_.audit.note(context_.who(*call), "catalogue.rebuild", {}, fmt::format("{} cases", cases->size()));
    return grpc::Status::OK;
  }

  grpc::Status ReadAudit(grpc::ServerContext*, const api::ReadAuditRequest* request,
                         api::ReadAuditResponse* response) override {
    const std::size_t limit = request->limit() == 0 ? 100 : std::min(request->limit(), 10'000u);
    const auto rows = last_audit_rows(context_.audit_file, request->case_id(), limit);
    if (!rows) return to_grpc(refuse(rows.error()).value());
    for (const AuditRow& row : *rows) {
      api::AuditLine& line = *response->add_line();
      line.set_number(row.number);
      line.set_time(row.time);
      line.set_who(row.who);
      line.set_action(row.what);
      line.set_case_id(row.case_id);
      line.set_detail(row.details);
    }
    return grpc::Status::OK;
  }

  grpc::Status VerifyAudit(grpc::ServerContext*, const api::VerifyAuditRequest*,
                           api::VerifyAuditResponse* response) override {
    std::vector<AuditHead> heads;
    if (const auto head = context_.catalogue.audit_head("audit.jsonl"); head && *head)
      heads.push_back(**head);
    const auto verdict = verify_audit(context_.audit_file, heads);
    if (!verdict) return to_grpc(refuse(verdict.error()).value());
    response->set_sound(verdict->good());
    response->set_lines(verdict->head.lines);
    if (!verdict->good())
      response->set_fault(
          fmt::format("line {}: {}", verdict->faults.front().line, verdict->faults.front().why));
    return grpc::Status::OK;
  }

 private:
  ServiceContext& context_;
};

}  // namespace

std::unique_ptr<grpc::Service> make_cases_service(ServiceContext& context) {
  return std::make_unique<CasesService>(context);
}
std::unique_ptr<grpc::Service> make_catalogue_service(ServiceContext& context) {
  return std::make_unique<CatalogueService>(context);
}

}  // namespace gnathion::daemon
