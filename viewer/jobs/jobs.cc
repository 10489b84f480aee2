#include "viewer/jobs/jobs.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <QCoreApplication>
#include <QObject>
#include <algorithm>
#include <optional>

namespace gnathion {

void JobContext::begin_step(std::string_view name, double share) {
  throw_if_cancelled();
  const std::lock_guard lock(mutex_);
  step_ = std::string(name);
  step_start_ = std::min(1.0, step_start_ + step_share_);
  step_share_ = share;
  done_ = step_start_;
}

void JobContext::update(double fraction) {
  throw_if_cancelled();
  done_ = std::min(1.0, step_start_ + step_share_ * fraction);
}

struct JobRunner::Job {
  QString name;
  std::string slot;
  Work work;
  std::function<void(bool)> done;
  JobContext context;
  std::thread thread;
};

struct JobRunner::Slot {
  std::string name;
  bool running = false;
  struct Asked {
    Work work;
    std::function<void()> done, lost;
  };
  std::optional<Asked> waiting;
};

JobRunner::JobRunner() : gui_(std::make_unique<QObject>()) {}

JobRunner::~JobRunner() {
  for (const auto& job : jobs_) job->context.cancel_ = true;
  for (const auto& job : jobs_)
    if (job->thread.joinable()) job->thread.join();
  gui_.reset();  // results that are on their way are dropped with it
}

void JobRunner::start(std::shared_ptr<Job> job) {
  jobs_.push_back(job);
  QObject* gui = gui_.get();
  job->thread = std::thread([this, job, gui] {
    // Threads that the work starts inherit this: the window's own drawing goes first.
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), 10);
    std::string trouble;
    try {
      job->work(job->context);
    } catch (const JobCancelled&) {
    } catch (const std::exception& e) {
      trouble = e.what();
    }
    job->context.finished_ = true;
    QMetaObject::invokeMethod(
        gui, [this, job, trouble] { finish(job, trouble); }, Qt::QueuedConnection);
  });
}

void JobRunner::finish(const std::shared_ptr<Job>& job, const std::string& trouble) {
  if (job->thread.joinable()) job->thread.join();
  jobs_.erase(std::remove(jobs_.begin(), jobs_.end(), job), jobs_.end());
  if (!trouble.empty()) failed(job->name + ": " + QString::fromStdString(trouble));
  if (job->done) job->done(job->context.cancelled() || !trouble.empty());
  if (!job->name.isEmpty()) changed();
}

void JobRunner::run(const QString& name, Work work, std::function<void(bool)> done) {
  auto job = std::make_shared<Job>();
  job->name = name;
  job->work = std::move(work);
  job->done = std::move(done);
  start(job);
  changed();
}

void JobRunner::run_latest(const std::string& slot_name, Work work, std::function<void()> done,
                           std::function<void()> lost) {
  auto at = std::find_if(slots_.begin(), slots_.end(), [&](const auto& s) { return s->name == slot_name; });
  if (at == slots_.end()) {
    slots_.push_back(std::make_unique<Slot>());
    slots_.back()->name = slot_name;
    at = slots_.end() - 1;
  }
  Slot* slot = at->get();
  if (slot->running) {
    slot->waiting = Slot::Asked{std::move(work), std::move(done), std::move(lost)};
    return;
  }
  slot->running = true;
  auto job = std::make_shared<Job>();
  job->slot = slot_name;
  job->work = std::move(work);
  const JobContext* context = &job->context;  // outlives the call of `done`
  job->done = [this, slot, context, done = std::move(done), lost = std::move(lost)](bool without_result) {
    slot->running = false;
    if (!without_result && done) done();
    if (without_result && !context->cancelled() && lost) lost();
    if (!slot->waiting || slot->running) return;
    Slot::Asked next = std::move(*slot->waiting);
    slot->waiting.reset();
    run_latest(slot->name, std::move(next.work), std::move(next.done), std::move(next.lost));
  };
  start(job);
}

void JobRunner::cancel_latest(const std::string& slot_name) {
  for (const auto& slot : slots_)
    if (slot->name == slot_name) slot->waiting.reset();
  for (const auto& job : jobs_)
    if (job->slot == slot_name) job->context.cancel_ = true;
}

void JobRunner::cancel_all() {
  for (const auto& job : jobs_)
    if (!job->name.isEmpty()) job->context.cancel_ = true;
}

bool JobRunner::busy() const {
  return std::any_of(jobs_.begin(), jobs_.end(), [](const auto& j) { return !j->name.isEmpty(); });
}

bool JobRunner::any() const {
  return !jobs_.empty();
}

JobState JobRunner::state() const {
  for (const auto& job : jobs_) {
    if (job->name.isEmpty()) continue;
    const std::lock_guard lock(job->context.mutex_);
    return {job->name, QString::fromStdString(job->context.step_), job->context.done_};
  }
  return {};
}

}  // namespace gnathion
