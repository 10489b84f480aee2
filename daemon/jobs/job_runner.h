// The queue of jobs and the threads that run them, each job a process of its own.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/time.h"
#include "daemon/api_error.h"
#include "daemon/heartbeat.h"
#include "daemon/jobs/job_work.h"
#include "daemon/mailbox.h"

namespace gnathion::daemon {

enum class JobState { kQueued, kRunning, kDone, kGateFailed, kFailed, kCancelled };
const char* name_of(JobState state);

struct JobView {
  std::string id, case_id, kind, who;
  JobState state = JobState::kQueued;
  std::string step, message;
  double step_fraction = 0, fraction = 0;
  HostTime submitted, started, ended;
  int exit_code = 0;
  bool finished() const { return state != JobState::kQueued && state != JobState::kRunning; }
};

struct JobOutcome {
  JobView view;
  std::string json;
  std::vector<std::string> outputs;
};

struct JobRunnerOptions {
  std::filesystem::path program;
  int parallel = 1, queued = 64, nice = 10;
  std::function<void(const std::string& case_id)> ended;  ///< a job of this case has ended; from its thread
};

/// Thread-safe.
class JobRunner {
 public:
  JobRunner(JobRunnerOptions options, const CaseRoot& root, Clock& clock);
  /// Running jobs are cancelled.
  ~JobRunner();

  ApiResult<JobView> submit(const JobOrder& order);
  ApiResult<JobView> view(const std::string& id) const;
  /// Asks for the end and returns when it has come. Of a finished job: nothing happens.
  ApiResult<JobView> cancel(const std::string& id);
  ApiResult<JobOutcome> outcome(const std::string& id) const;
  std::vector<JobView> list(const std::string& case_id, std::size_t limit) const;
  /// Each change of one job; closed after the last.
  ApiResult<std::shared_ptr<Mailbox<JobView>>> watch(const std::string& id);
  void stop();  ///< cancels everything; further orders are refused

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion::daemon
