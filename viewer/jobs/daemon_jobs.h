// Jobs that a daemon computes for the open case: submitted, followed, cancelled; those of others are seen
// too.
#pragma once

#include <QString>
#include <QTimer>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "client/daemon_client.h"
#include "viewer/jobs/jobs.h"
#include "viewer/model/document.h"

namespace gnathion {

/// GUI thread only. The list is asked for again and again: what another client submitted, or what ran before
/// the connection broke, is in it like anything else.
class DaemonJobs {
 public:
  DaemonJobs(Document& document, JobRunner& runner);

  void joined(std::shared_ptr<client::DaemonClient> client);
  void lost();
  /// Does the open folder lie in the daemon's root? Asked when it is opened, and at `look_again`.
  void look_again();
  bool serves_case() const { return client_ && serves_; }
  bool away() const { return !client_; }

  /// `ended` comes once, in whatever state the job ended; failures are reported besides.
  void submit(client::JobRequest request, std::function<void(const client::Job&)> ended);
  void cancel(const std::string& id);
  bool running(const std::string& kind) const;                    ///< submitted here, and not ended
  void cancel_kind(const std::string& kind);                      ///< those that were submitted here
  const std::vector<client::Job>& jobs() const { return jobs_; }  ///< of the open case, newest first

  Listeners<> changed;

 private:
  void poll();
  void take(std::vector<client::Job> now);
  void end(const client::Job& job);

  struct Waiting {
    std::string kind;
    std::function<void(const client::Job&)> ended;
  };
  Document& document_;
  JobRunner& runner_;
  std::shared_ptr<client::DaemonClient> client_;
  bool serves_ = false;
  std::filesystem::path folder_;  ///< whose jobs these are
  int asked_ = 0;                 ///< lists that were asked for before the newest submission are too old
  std::vector<client::Job> jobs_;
  std::multiset<std::string> on_their_way_;  ///< kinds submitted that the daemon has not answered yet
  std::map<std::string, Waiting> waiting_;   ///< by id
  QTimer timer_;
};

}  // namespace gnathion
