#include "viewer/jobs/daemon_jobs.h"

#include <sys/stat.h>

#include <algorithm>

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr int kFollowMs = 300, kIdleMs = 3000;

/// What it was given is the folder's: size by size, and written at the same moment, as a copy's is not. What
/// grows or comes proves nothing: recordings, results.
bool same_folder(const client::Case& listed, const fs::path& folder) {
  bool any = false;
  for (const client::CaseFile& file : listed.files) {
    if (file.role.empty() || file.role == "result" || file.role == "calibration") continue;
    if (file.role.find("recording") != std::string::npos) continue;
    struct stat here {};
    if (::stat((folder / file.path).c_str(), &here) != 0) return false;
    const std::int64_t modified_ns = here.st_mtim.tv_sec * std::int64_t{1'000'000'000} + here.st_mtim.tv_nsec;
    if (static_cast<std::uint64_t>(here.st_size) != file.bytes || modified_ns != file.modified_ns)
      return false;
    any = true;
  }
  return any;
}

}  // namespace

DaemonJobs::DaemonJobs(Document& document, JobRunner& runner) : document_(document), runner_(runner) {
  timer_.setSingleShot(true);
  QObject::connect(&timer_, &QTimer::timeout, [this] { poll(); });
  document_.opened.add([this] { look_again(); });
}

void DaemonJobs::joined(std::shared_ptr<client::DaemonClient> client) {
  client_ = std::move(client);
  look_again();
}

void DaemonJobs::lost() {
  if (!client_) return;
  client_.reset();
  timer_.stop();
  changed();
}

void DaemonJobs::look_again() {
  if (!document_.is_open()) return;
  if (folder_ != document_.content().folder) {  // not the same case read anew
    folder_ = document_.content().folder;
    serves_ = false;
    jobs_.clear();
    waiting_.clear();
    changed();
  }
  if (!client_) return;
  auto serves = std::make_shared<bool>(false);
  runner_.run_latest(
      "daemon case",
      [client = client_, content = document_.shared_content(), serves](JobContext&) {
        if (const auto listed = client->open_case(content->title))
          *serves = same_folder(*listed, content->folder);
      },
      [this, serves, content = document_.shared_content()] {
        if (document_.shared_content() != content) return look_again();
        serves_ = *serves;
        if (!serves_) jobs_.clear();
        changed();
        poll();
      });
}

void DaemonJobs::poll() {
  if (!serves_case()) return;
  auto found = std::make_shared<Result<std::vector<client::Job>>>(tl::unexpected<Error>(Error{}));
  runner_.run_latest(
      "daemon jobs",
      [client = client_, id = document_.content().title, found](JobContext&) { *found = client->jobs(id); },
      [this, client = client_, folder = folder_, asked = asked_, found] {
        if (client_ != client || folder_ != folder) return;
        if (asked != asked_) return poll();
        if (*found) take(std::move(**found));
        const bool follow =
            std::any_of(jobs_.begin(), jobs_.end(), [](const client::Job& j) { return !j.finished(); });
        timer_.start(follow ? kFollowMs : kIdleMs);
      });
}

void DaemonJobs::take(std::vector<client::Job> now) {
  const auto known = [&](const std::string& id) {
    return std::any_of(now.begin(), now.end(), [&](const client::Job& j) { return j.id == id; });
  };
  // A daemon that was started anew knows nothing of the jobs that died with the one before.
  for (client::Job job : jobs_) {
    if (known(job.id)) continue;
    if (!job.finished()) {
      job.state = client::JobState::kFailed;
      job.message = "it ended with the daemon; start it again";
    }
    now.push_back(std::move(job));
  }
  jobs_ = std::move(now);
  std::vector<client::Job> over;
  for (const client::Job& job : jobs_)
    if (job.finished() && waiting_.count(job.id)) over.push_back(job);
  changed();
  for (const client::Job& job : over) end(job);
}

void DaemonJobs::end(const client::Job& job) {
  const auto at = waiting_.find(job.id);
  const auto ended = std::move(at->second.ended);
  waiting_.erase(at);
  const QString name = QString::fromStdString(job.kind);
  if (job.state == client::JobState::kFailed)
    document_.report(QString("The daemon's %1: %2").arg(name, QString::fromStdString(job.message)));
  if (job.state == client::JobState::kCancelled)
    document_.notice(QString("The daemon's %1 was cancelled; nothing was written.").arg(name));
  if (ended) ended(job);
  changed();
}

void DaemonJobs::submit(client::JobRequest request, std::function<void(const client::Job&)> ended) {
  client::Job refused;
  refused.kind = request.kind;
  refused.state = client::JobState::kFailed;
  if (!serves_case()) {
    document_.report("The daemon is away: the job was not submitted.");
    return ended(refused);
  }
  request.case_id = document_.content().title;
  auto made = std::make_shared<Result<client::Job>>(tl::unexpected<Error>(Error{}));
  on_their_way_.insert(request.kind);
  // A slot of its own for each: none may push another out.
  static int number = 0;
  runner_.run_latest(
      "daemon submit " + std::to_string(++number),
      [client = client_, request, made](JobContext&) { *made = client->submit(request); },
      [this, made, refused, ended, folder = folder_] {
        ++asked_;
        on_their_way_.erase(on_their_way_.find(refused.kind));
        if (!*made) {
          document_.report(QString::fromStdString(made->error().line()));
          return ended(refused);
        }
        if (folder_ != folder) return;  // another case by now: the job goes on without this window
        waiting_[(*made)->id] = {(*made)->kind, ended};
        jobs_.insert(jobs_.begin(), **made);
        changed();
        poll();
      });
}

void DaemonJobs::cancel(const std::string& id) {
  if (!client_) return document_.report("The daemon is away: jobs end with it.");
  auto trouble = std::make_shared<std::string>();
  runner_.run_latest(
      "daemon cancel " + id,
      [client = client_, id, trouble](JobContext&) {
        if (const auto done = client->cancel(id); !done) *trouble = done.error().line();
      },
      [this, trouble] {
        if (!trouble->empty()) document_.report(QString::fromStdString(*trouble));
        poll();
      });
}

bool DaemonJobs::running(const std::string& kind) const {
  if (on_their_way_.count(kind) > 0) return true;
  return std::any_of(waiting_.begin(), waiting_.end(),
                     [&](const auto& entry) { return entry.second.kind == kind; });
}

void DaemonJobs::cancel_kind(const std::string& kind) {
  for (const auto& [id, job] : waiting_)
    if (job.kind == kind) cancel(id);
}

}  // namespace gnathion
