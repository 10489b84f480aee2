// The daemon's jobs of the open case, in every step: state, progress, message, cancel. Hidden without any.
#pragma once

#include <QWidget>
#include <string>
#include <vector>

#include "viewer/jobs/daemon_jobs.h"

class QLabel;
class QPushButton;
class QTableWidget;

namespace gnathion {

class JobsList : public QWidget {
 public:
  explicit JobsList(DaemonJobs& daemon);

 private:
  void refresh();
  void show_chosen();

  DaemonJobs& daemon_;
  QTableWidget* table_;
  QLabel* message_;
  QPushButton* cancel_;
  std::vector<std::string> ids_;
};

}  // namespace gnathion
