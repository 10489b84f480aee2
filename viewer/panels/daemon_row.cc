#include "viewer/panels/daemon_row.h"

#include <QHBoxLayout>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/transform_io.h"
#include "viewer/widgets/parts.h"

namespace gnathion {

DaemonRow::DaemonRow(Workbench& bench, Step step) : bench_(bench) {
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(4);
  row->addWidget(wrapped("Daemon:", true), 0);
  for (const DaemonTask& task : daemon_tasks(step))
    row->addWidget(button(task.label, task.object, QString(task.tip) + ". The daemon computes it.",
                          [this, &task] { submit(task); }),
                   1);
  setVisible(false);
  bench_.daemon.changed.add([this] { setVisible(bench_.daemon.serves_case()); });
}

void DaemonRow::submit(const DaemonTask& task) {
  const auto request = task.request(bench_.document.content(), bench_.document.state());
  if (!request) return bench_.document.report(QString::fromStdString(request.error().line()));
  // Two would be given the same name for what they write.
  if (bench_.daemon.running(request->kind))
    return bench_.document.report(QString("The daemon's %1 runs already: wait for it, or cancel it.")
                                      .arg(QString::fromStdString(request->kind)));
  const auto folder = bench_.document.content().folder;
  bench_.daemon.submit(
      *request, [this, &task, folder, output = folder / output_of(*request)](const client::Job& job) {
        const bool made = job.state == client::JobState::kDone || job.state == client::JobState::kGateFailed;
        if (made && bench_.document.is_open() && bench_.document.content().folder == folder)
          take(task, job, output);
      });
}

void DaemonRow::take(const DaemonTask& task, const client::Job& job, const std::filesystem::path& output) {
  const QString name = QString("jobs/") + QString::fromStdString(output.filename().string());
  const auto failed = [&](const Error& e) { bench_.document.report(QString::fromStdString(e.line())); };
  const bool gate = job.state == client::JobState::kGateFailed;
  if (gate && (task.after == JobAfter::kReadCase || !std::filesystem::exists(output))) {
    bench_.document.report(QString("The daemon's %1: %2")
                               .arg(QString::fromStdString(job.kind), QString::fromStdString(job.message)));
    if (task.after == JobAfter::kReadCase) bench_.reload();
    return;
  }
  if (task.after == JobAfter::kReadCase) {
    bench_.document.notice(
        QString("The daemon's %1 is done; its results are shown.").arg(QString::fromStdString(job.kind)));
    return bench_.reload();
  }
  if (task.after == JobAfter::kTakeTransform) {
    const auto read = read_motion(output);
    if (!read) return failed(read.error());
    bench_.document.change("T_th of the daemon's job", [&](SessionState& s) {
      s.therapeutic = read->motion.rigid;
      s.therapeutic_source = name.toStdString();
    });
    return bench_.document.notice("T_th is that of " + name + "; undo takes it back.");
  }
  const auto report = read_json(output);
  if (!report) return failed(report.error());
  const QString verdict = QString::fromStdString(report->value("verdict", std::string("?")));
  bench_.document.notice("Checked by the daemon: " + QString(verdict).replace('_', ' ') + " (" + name + ")");
}

}  // namespace gnathion
