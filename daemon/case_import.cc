#include "daemon/case_import.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/utc.h"
#include "daemon/jobs/child.h"
#include "pipeline/case_folder.h"
#include "pipeline/import_case.h"

namespace gnathion::daemon {

namespace fs = std::filesystem;
namespace {

constexpr int kMostUploads = 2;

/// A name, or a few of them with slashes, of which none is hidden, climbs or holds what is no text.
bool is_plain(const std::string& name) {
  const fs::path path(name);
  if (name.empty() || name.size() > 500 || path.is_absolute()) return false;
  if (std::any_of(name.begin(), name.end(), [](unsigned char c) { return c < 32 || c == 127; })) return false;
  for (const fs::path& part : path)
    if (part.empty() || part.string().front() == '.' || part.string().size() > 200) return false;
  return std::distance(path.begin(), path.end()) <= kDeepestImportSource;
}

/// What the command says, without its own name and without this machine's folders.
std::string told(std::string line, const fs::path& source, const fs::path& root) {
  constexpr std::string_view kSelf = "gnathion: ";
  if (line.rfind(kSelf, 0) == 0) line.erase(0, kSelf.size());
  for (const fs::path& folder : {source / "", source.parent_path() / "", root / ""})
    for (std::size_t at; (at = line.find(folder.string())) != std::string::npos;)
      line.erase(at, folder.string().size());
  return line;
}

ApiError error_of(const ChildEnd& end, const fs::path& source, const fs::path& root) {
  if (end.cancelled) return {ApiCode::kUnavailable, "the import was given up"};
  if (end.signal != 0)
    return {ApiCode::kInvalidArgument,
            fmt::format("the files made the import end by signal {}: they are damaged", end.signal)};
  const std::string line = told(end.error, source, root);
  if (end.exit_code == exit_code(ErrorCode::kInput)) return {ApiCode::kInvalidArgument, line};
  if (end.exit_code == exit_code(ErrorCode::kUsage)) return {ApiCode::kFailedPrecondition, line};
  return {ApiCode::kInternal, line};
}

/// What the process `pid` left beside the cases: ".import.ID.staging.PID", ".ID.staging.PID".
void remove_staging(const fs::path& root, int pid) {
  const std::string ending = fmt::format(".staging.{}", pid);
  std::error_code ec;
  for (const auto& entry : fs::directory_iterator(root, ec)) {
    const std::string name = entry.path().filename().string();
    std::error_code one;
    if (name.front() == '.' && name.size() > ending.size() &&
        name.compare(name.size() - ending.size(), ending.size(), ending) == 0)
      fs::remove_all(entry.path(), one);
  }
}

}  // namespace

std::string made_case_id(Clock& clock) {
  std::string id = "case-";
  for (const char c : utc_text(clock.now()))
    if (std::isdigit(static_cast<unsigned char>(c)))
      id += c;
    else if (c == 'T')
      id += '-';
  return id;
}

CaseImporter::CaseImporter(ImporterOptions options, const CaseRoot& root, Clock& clock)
    : options_(std::move(options)), root_(root), clock_(clock) {
  std::error_code ec;
  fs::remove_all(options_.folder, ec);
}

fs::path CaseImporter::own_folder(const char* kind) {
  const fs::path folder = options_.folder / fmt::format("{}-{}", kind, ++number_);
  std::error_code ec;
  fs::create_directories(folder, ec);
  return folder;
}

ApiResult<std::string> CaseImporter::import(const fs::path& source, const ImportOrder& order,
                                            const std::function<bool()>& cancelled) {
  const std::unique_lock lock(one_at_a_time_, std::try_to_lock);  // who waits keeps a thread from others
  if (!lock)
    return refuse(ApiCode::kResourceExhausted, "another import is at work: try again when it has ended");
  const std::string id = order.case_id.empty() ? made_case_id(clock_) : order.case_id;
  if (const Status good = check_case_id(id); !good) return refuse(good.error());
  const auto folder = root_.case_folder(id, PathUse::kNew);
  if (!folder) return refuse(folder.error());
  std::error_code ec;
  if (fs::exists(fs::symlink_status(*folder, ec)))
    return refuse(ApiCode::kAlreadyExists, fmt::format("the case '{}' exists: choose another id", id));
  ChildOrder child{options_.program, {"case", "import", source.string()}, own_folder("work"), options_.nice};
  child.arguments.push_back("--out=" + folder->string());
  child.arguments.push_back("--id=" + id);
  for (const auto& [role, name] : order.roles)
    child.arguments.push_back(fmt::format("--role={}={}", role, name));
  if (order.trust_names) child.arguments.push_back("--trust-names");
  child.arguments.push_back("--json");
  const auto ran = run_child(child, cancelled, [](const ChildProgress&) {});
  fs::remove_all(child.work, ec);
  if (!ran) return refuse(ran.error());
  if (ran->exit_code == 0) return id;
  remove_staging(root_.path(), ran->pid);
  return tl::unexpected<ApiError>(error_of(*ran, source, root_.path()));
}

ApiResult<std::unique_ptr<Upload>> CaseImporter::upload() {
  if (++uploads_ > kMostUploads) {
    --uploads_;
    return refuse(
        ApiCode::kResourceExhausted,
        fmt::format("{} clients are sending files already: try again when one is done", kMostUploads));
  }
  return std::unique_ptr<Upload>(new Upload(own_folder("files"), options_.most_bytes, uploads_));
}

Upload::~Upload() {
  close_file();
  std::error_code ec;
  fs::remove_all(folder_, ec);
  --count_;
}

void Upload::close_file() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

ApiStatus Upload::begin_file(const std::string& name) {
  close_file();
  if (!is_plain(name))
    return refuse(
        ApiCode::kPermissionDenied,
        fmt::format("a file's name is a plain name, or a path of at most {}, without '..' and nothing hidden",
                    kDeepestImportSource));
  if (++files_ > kMostFiles)
    return refuse(ApiCode::kResourceExhausted,
                  fmt::format("more than {} files: send a case's alone", kMostFiles));
  const fs::path path = folder_ / name;
  std::error_code ec;
  fs::create_directories(path.parent_path(), ec);
  fd_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
  if (fd_ >= 0) return {};
  return errno == EEXIST
             ? refuse(ApiCode::kInvalidArgument, "a file is sent twice")
             : refuse(ApiCode::kInternal, std::string("cannot take a file: ") + std::strerror(errno));
}

ApiStatus Upload::write(std::string_view bytes) {
  if (bytes.empty()) return {};
  if (fd_ < 0) return refuse(ApiCode::kInvalidArgument, "bytes come before the name of their file");
  bytes_ += bytes.size();
  if (bytes_ > most_bytes_)
    return refuse(
        ApiCode::kResourceExhausted,
        fmt::format("more than {} MiB: raise 'import_mib' in [limits] of gnathiond.toml", most_bytes_ >> 20));
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return refuse(ApiCode::kInternal, std::string("cannot take a file: ") + std::strerror(errno));
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return {};
}

ApiResult<fs::path> Upload::finish(const std::string& source) {
  close_file();
  if (files_ == 0) return refuse(ApiCode::kInvalidArgument, "no file was sent");
  if (source.empty()) return folder_;
  std::error_code ec;
  if (!is_plain(source) || !fs::is_regular_file(fs::symlink_status(folder_ / source, ec)))
    return refuse(ApiCode::kInvalidArgument, "the source is none of the files that were sent");
  return folder_ / source;
}

}  // namespace gnathion::daemon
