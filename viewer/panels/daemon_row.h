// A step's jobs for the daemon, as buttons; hidden unless the open case is the daemon's.
#pragma once

#include "viewer/model/daemon_requests.h"
#include "viewer/panels/panel.h"

namespace gnathion {

class DaemonRow : public QWidget {
 public:
  DaemonRow(Workbench& bench, Step step);

 private:
  void submit(const DaemonTask& task);
  void take(const DaemonTask& task, const client::Job& job, const std::filesystem::path& output);
  Workbench& bench_;
};

}  // namespace gnathion
