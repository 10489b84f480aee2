#include "daemon/jobs/job_runner.h"

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "core/log.h"
#include "daemon/jobs/child.h"

namespace gnathion::daemon {
namespace {

constexpr std::size_t kKept = 1000;
constexpr std::size_t kKeptJsonBytes = std::size_t{64} << 20;

struct Job {
  JobView view;
  JobPlan plan;
  Hub<JobView> changes;
  std::atomic<bool> cancel{false};
  std::string json;
};

JobState state_of(const ChildEnd& end) {
  if (end.cancelled) return JobState::kCancelled;
  if (end.exit_code == 0) return JobState::kDone;
  return end.exit_code == exit_code(ErrorCode::kGate) ? JobState::kGateFailed : JobState::kFailed;
}

/// The command speaks of the work folder; clients know the case's folder.
std::string with_final_places(std::string text, const JobPlan& plan) {
  const auto replace_all = [&](const std::string& from, const std::string& to) {
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
      text.replace(at, from.size(), to);
  };
  for (const JobPlan::Output& output : plan.outputs)
    replace_all(output.made.string(), output.final_place.string());
  replace_all(plan.case_folder.string() + "/", "");
  return text;
}

}  // namespace

const char* name_of(JobState state) {
  constexpr std::array names = {"queued", "running", "done", "gate failed", "failed", "cancelled"};
  return names[static_cast<std::size_t>(state)];
}

struct JobRunner::Impl {
  Impl(JobRunnerOptions o, const CaseRoot& r, Clock& c) : options(std::move(o)), root(r), clock(c) {}
  void work();
  void run(Job& job);
  void finish(Job& job, JobState state, const ChildEnd& end);
  void forget_old();
  std::shared_ptr<Job> find(const std::string& id) const;
  void tell(Job& job) { job.changes.publish(std::make_shared<const JobView>(job.view), true); }

  const JobRunnerOptions options;
  const CaseRoot& root;
  Clock& clock;
  std::vector<std::thread> workers;

  mutable std::mutex mutex;  ///< of what follows, and of each job's view and json
  std::condition_variable changed;
  std::deque<std::shared_ptr<Job>> queue;
  std::deque<std::shared_ptr<Job>> all;  ///< newest last
  std::uint64_t count = 0;
  bool stopping = false;
};

JobRunner::JobRunner(JobRunnerOptions options, const CaseRoot& root, Clock& clock)
    : impl_(std::make_unique<Impl>(std::move(options), root, clock)) {
  for (int i = 0; i < impl_->options.parallel; ++i) {
    impl_->workers.emplace_back([s = impl_.get()] { s->work(); });
    ::pthread_setname_np(impl_->workers.back().native_handle(), "job");
  }
}

JobRunner::~JobRunner() {
  stop();
}

void JobRunner::stop() {
  {
    std::lock_guard lock(impl_->mutex);
    impl_->stopping = true;
    for (const auto& job : impl_->all) job->cancel = true;
    impl_->changed.notify_all();
  }
  for (std::thread& worker : impl_->workers)
    if (worker.joinable()) worker.join();
}

std::shared_ptr<Job> JobRunner::Impl::find(const std::string& id) const {
  for (const auto& job : all)
    if (job->view.id == id) return job;
  return nullptr;
}

void JobRunner::Impl::forget_old() {
  std::size_t json_bytes = 0;
  for (auto job = all.rbegin(); job != all.rend(); ++job) {
    json_bytes += (*job)->json.size();
    if (json_bytes > kKeptJsonBytes) (*job)->json.clear();
  }
  // The oldest that have ended, also behind one that still runs.
  for (auto job = all.begin(); all.size() > kKept && job != all.end();)
    job = (*job)->view.finished() ? all.erase(job) : job + 1;
}

ApiResult<JobView> JobRunner::submit(const JobOrder& order) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const std::string id = fmt::format("job-{}-{}", s.clock.now().ns / 1'000'000'000, ++s.count);
  lock.unlock();
  auto plan = plan_job(s.root, order, id);
  if (!plan) return tl::unexpected(plan.error());
  auto job = std::make_shared<Job>();
  job->plan = std::move(*plan);
  job->view.id = id;
  job->view.case_id = order.case_id;
  job->view.kind = order.kind;
  job->view.who = order.who;
  job->view.submitted = s.clock.now();
  lock.lock();
  if (s.stopping)
    return refuse(ApiCode::kUnavailable, "gnathiond is going down: submit again when it is back");
  if (s.queue.size() >= static_cast<std::size_t>(s.options.queued))
    return refuse(ApiCode::kResourceExhausted,
                  fmt::format("{} jobs are waiting already: cancel some or wait", s.queue.size()));
  s.queue.push_back(job);
  s.all.push_back(job);
  s.forget_old();
  s.tell(*job);
  s.changed.notify_all();
  return job->view;
}

void JobRunner::Impl::work() {
  while (true) {
    std::shared_ptr<Job> job;
    {
      std::unique_lock lock(mutex);
      changed.wait(lock, [&] { return stopping || !queue.empty(); });
      if (queue.empty()) return;
      job = queue.front();
      queue.pop_front();
    }
    run(*job);
  }
}

void JobRunner::Impl::run(Job& job) {
  ChildEnd end;
  end.cancelled = job.cancel;
  if (!end.cancelled) {
    {
      std::lock_guard lock(mutex);
      job.view.state = JobState::kRunning;
      job.view.started = clock.now();
      tell(job);
    }
    const auto report = [&](const ChildProgress& progress) {
      std::lock_guard lock(mutex);
      job.view.step = progress.step;
      job.view.step_fraction = progress.step_fraction;
      job.view.fraction = progress.fraction;
      tell(job);
    };
    Status prepared = prepare(job.plan);
    auto ran = prepared ? run_child(
                              {options.program, job.plan.arguments, job.plan.work, options.nice},
                              [&] { return job.cancel.load(); }, report)
                        : Result<ChildEnd>(tl::unexpected<Error>(prepared.error()));
    if (ran)
      end = std::move(*ran);
    else
      end.error = ran.error().line();
  }
  JobState state = state_of(end);
  if (state == JobState::kDone || state == JobState::kGateFailed)
    if (const Status placed = publish(job.plan); !placed) {
      state = JobState::kFailed;
      end.error = placed.error().line();
    }
  clean(job.plan, end.pid);
  if (options.ended) options.ended(job.view.case_id);
  finish(job, state, end);
}

void JobRunner::Impl::finish(Job& job, JobState state, const ChildEnd& end) {
  std::lock_guard lock(mutex);
  JobView& view = job.view;
  view.state = state;
  view.ended = clock.now();
  view.exit_code = end.exit_code;
  if (state == JobState::kCancelled) {
    view.message = "cancelled";
  } else if (state != JobState::kDone) {
    view.message = end.signal != 0 ? fmt::format("ended by signal {}", end.signal)
                                   : with_final_places(end.error, job.plan);
  } else {
    view.fraction = view.step_fraction = 1;
  }
  job.json = with_final_places(end.output, job.plan);
  job.plan.arguments = {};  // a thousand jobs are remembered, with up to a megabyte of words each
  log(LogLevel::kInfo,
      fmt::format("job {} {} of case {}: {}", view.id, view.kind, view.case_id, name_of(state)));
  tell(job);
  job.changes.close();
  changed.notify_all();
}

ApiResult<JobView> JobRunner::view(const std::string& id) const {
  std::lock_guard lock(impl_->mutex);
  const auto job = impl_->find(id);
  if (!job)
    return refuse(ApiCode::kNotFound, fmt::format("there is no job '{}'; `gnathion jobs` lists them", id));
  return job->view;
}

ApiResult<JobView> JobRunner::cancel(const std::string& id) {
  Impl& s = *impl_;
  std::unique_lock lock(s.mutex);
  const auto job = s.find(id);
  if (!job)
    return refuse(ApiCode::kNotFound, fmt::format("there is no job '{}'; `gnathion jobs` lists them", id));
  job->cancel = true;
  const auto waiting = std::find(s.queue.begin(), s.queue.end(), job);
  if (waiting != s.queue.end()) {
    s.queue.erase(waiting);
    lock.unlock();
    ChildEnd end;
    end.cancelled = true;
    s.finish(*job, JobState::kCancelled, end);
    lock.lock();
  }
  s.changed.wait_for(lock, std::chrono::seconds(5), [&] { return job->view.finished(); });
  return job->view;
}

ApiResult<JobOutcome> JobRunner::outcome(const std::string& id) const {
  std::lock_guard lock(impl_->mutex);
  const auto job = impl_->find(id);
  if (!job)
    return refuse(ApiCode::kNotFound, fmt::format("there is no job '{}'; `gnathion jobs` lists them", id));
  if (!job->view.finished())
    return refuse(
        ApiCode::kFailedPrecondition,
        fmt::format("job {} is {}: wait for its end (Progress), or cancel it", id, name_of(job->view.state)));
  JobOutcome outcome{job->view, job->json, {}};
  if (job->view.state == JobState::kDone || job->view.state == JobState::kGateFailed)
    for (const JobPlan::Output& output : job->plan.outputs) outcome.outputs.push_back(output.shown);
  return outcome;
}

std::vector<JobView> JobRunner::list(const std::string& case_id, std::size_t limit) const {
  std::lock_guard lock(impl_->mutex);
  std::vector<JobView> views;
  for (auto job = impl_->all.rbegin(); job != impl_->all.rend() && views.size() < limit; ++job)
    if (case_id.empty() || (*job)->view.case_id == case_id) views.push_back((*job)->view);
  return views;
}

ApiResult<std::shared_ptr<Mailbox<JobView>>> JobRunner::watch(const std::string& id) {
  std::lock_guard lock(impl_->mutex);
  const auto job = impl_->find(id);
  if (!job)
    return refuse(ApiCode::kNotFound, fmt::format("there is no job '{}'; `gnathion jobs` lists them", id));
  return job->changes.subscribe(1);
}

}  // namespace gnathion::daemon
