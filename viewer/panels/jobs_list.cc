#include "viewer/panels/jobs_list.h"

#include <QHBoxLayout>
#include <QHeaderView>
#include <QProgressBar>
#include <algorithm>

#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

constexpr int kShown = 20;

QString state_of(const client::Job& job, bool away) {
  if (away && !job.finished()) return "? daemon away";
  switch (job.state) {
    case client::JobState::kQueued:
      return "waits";
    case client::JobState::kRunning:
      return "runs";
    case client::JobState::kDone:
      return "✓ done";
    case client::JobState::kGateFailed:
      return "✗ gate failed";
    case client::JobState::kFailed:
      return "✗ failed";
    case client::JobState::kCancelled:
      return "– cancelled";
  }
  return {};
}

}  // namespace

JobsList::JobsList(DaemonJobs& daemon) : daemon_(daemon) {
  setObjectName("jobsList");
  setAttribute(Qt::WA_StyledBackground);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 4, 10, 6);
  column->setSpacing(3);
  auto* head = new QHBoxLayout;
  head->addWidget(heading("Jobs of the daemon"), 1);
  cancel_ = button("Cancel job", "cancelJob", "Ends the chosen job; nothing half-made is left", [this] {
    const int row = table_->currentRow();
    if (row >= 0) daemon_.cancel(ids_.at(static_cast<std::size_t>(row)));
  });
  head->addWidget(cancel_);
  column->addLayout(head);
  table_ = plain_table({"Job", "State", "Progress"}, "jobsTable");
  table_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  table_->setColumnWidth(1, 96);
  table_->setColumnWidth(2, 90);
  table_->setFixedHeight(96);
  connect(table_, &QTableWidget::itemSelectionChanged, this, [this] { show_chosen(); });
  column->addWidget(table_);
  message_ = wrapped("", true);
  message_->setObjectName("jobMessage");
  column->addWidget(message_);
  daemon_.changed.add([this] { refresh(); });
  refresh();
}

void JobsList::refresh() {
  const auto& jobs = daemon_.jobs();
  setVisible(!jobs.empty());
  const int rows = std::min(kShown, static_cast<int>(jobs.size()));
  const int before = table_->currentRow();
  const std::string chosen =
      before >= 0 && before < static_cast<int>(ids_.size()) ? ids_[static_cast<std::size_t>(before)] : "";
  const bool grown =
      rows > static_cast<int>(ids_.size()) || (rows && !ids_.empty() && ids_.front() != jobs.front().id);
  ids_.clear();
  table_->setRowCount(rows);
  int select = -1;
  for (int row = 0; row < rows; ++row) {
    const client::Job& job = jobs[static_cast<std::size_t>(row)];
    ids_.push_back(job.id);
    if (job.id == chosen) select = row;
    table_->setItem(row, 0, cell(QString::fromStdString(job.kind)));
    table_->setItem(row, 1, cell(state_of(job, daemon_.away())));
    auto* bar = qobject_cast<QProgressBar*>(table_->cellWidget(row, 2));
    if (!bar) {
      bar = new QProgressBar;
      bar->setRange(0, 1000);
      bar->setFormat("%p %");
      table_->setCellWidget(row, 2, bar);
    }
    bar->setVisible(!job.finished());
    bar->setValue(static_cast<int>(1000 * job.fraction));
  }
  if (grown) select = 0;  // the newest, that somebody has just asked for
  if (select >= 0) table_->selectRow(select);
  show_chosen();
}

void JobsList::show_chosen() {
  const int row = table_->currentRow();
  const auto& jobs = daemon_.jobs();
  const client::Job* job =
      row >= 0 && row < static_cast<int>(jobs.size()) ? &jobs[static_cast<std::size_t>(row)] : nullptr;
  cancel_->setEnabled(job && !job->finished() && !daemon_.away());
  if (!job) return message_->setText("");
  const QString text =
      QString::fromStdString(job->finished() || job->step.empty() ? job->message : job->step);
  message_->setText(text.isEmpty() ? state_of(*job, daemon_.away()) : text);
  message_->setToolTip("Submitted by " + QString::fromStdString(job->who));
}

}  // namespace gnathion
