// Work off the GUI thread: with a name, progress, cancel, and a result that comes back to the GUI thread.
#pragma once

#include <QString>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/progress.h"
#include "viewer/model/listeners.h"

class QObject;

namespace gnathion {

/// Thrown out of a Progress call to leave a job that the user cancelled. Caught in jobs.cc alone.
struct JobCancelled {};

/// What a job sees. Any thread.
class JobContext : public Progress {
 public:
  void begin_step(std::string_view name, double share) override;
  void update(double fraction) override;
  bool cancelled() const { return cancel_; }
  void throw_if_cancelled() const {
    if (cancel_) throw JobCancelled{};
  }

 private:
  friend class JobRunner;
  std::atomic<bool> cancel_{false}, finished_{false};
  std::atomic<double> done_{0.0};
  double step_start_ = 0.0, step_share_ = 0.0;
  mutable std::mutex mutex_;
  std::string step_;
};

struct JobState {
  QString name, step;
  double fraction = 0.0;
};

/// Runs jobs on threads of their own, at lower priority than the window. GUI thread only.
class JobRunner {
 public:
  JobRunner();
  ~JobRunner();  ///< cancels all, and waits

  using Work = std::function<void(JobContext&)>;
  /// `work` runs on a thread; then `done(cancelled)` on the GUI thread. Exceptions of work become `failed`.
  void run(const QString& name, Work work, std::function<void(bool cancelled)> done);
  /// The newest asker of a `slot` wins: while one runs, only the last one given waits. For what follows a
  /// mouse. Not shown as a job. `lost`, on the GUI thread: work ended by an exception, so `done` never comes.
  void run_latest(const std::string& slot, Work work, std::function<void()> done,
                  std::function<void()> lost = {});
  /// What runs in the slot is asked to end, what waits is dropped: neither `done` nor `lost` comes.
  void cancel_latest(const std::string& slot);
  void cancel_all();
  bool busy() const;       ///< a named job runs
  bool any() const;        ///< or anything else
  JobState state() const;  ///< of the named job that runs longest

  Listeners<> changed;  ///< a named job began or ended
  Listeners<const QString&> failed;

 private:
  struct Job;
  struct Slot;
  void start(std::shared_ptr<Job> job);
  void finish(const std::shared_ptr<Job>& job, const std::string& trouble);

  std::unique_ptr<QObject> gui_;  ///< results are posted to it; gone with this
  std::vector<std::shared_ptr<Job>> jobs_;
  std::vector<std::unique_ptr<Slot>> slots_;
};

}  // namespace gnathion
