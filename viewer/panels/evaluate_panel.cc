#include "viewer/panels/evaluate_panel.h"

#include <unistd.h>

#include <QComboBox>
#include <QGridLayout>
#include <QHeaderView>
#include <QLineEdit>

#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "evaluation/virtual_print.h"
#include "pipeline/evaluate_job.h"
#include "viewer/model/colour_maps.h"
#include "viewer/panels/daemon_row.h"

namespace gnathion {

struct EvaluatePanel::Found {
  std::string trouble, source;
  std::vector<SplintEvaluation> splints;
  std::vector<ProcedureTable> tables;
  std::vector<std::string> notes;
  std::vector<EvaluationFigure> figures;
  double range_mm = 0.2;
};

EvaluatePanel::EvaluatePanel(Workbench& bench) : Panel(bench, Step::kEvaluate) {
  setObjectName("evaluatePanel");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 8, 10, 8);
  column->addWidget(status_ = new StepStatus("evaluateStatus"));
  column->addWidget(new DaemonRow(bench_, Step::kEvaluate));
  column->addWidget(heading("Scans after printing"));
  column->addWidget(make_scans());
  column->addWidget(heading("Procedures"));
  table_ = plain_table({"Procedure", "Mean", "± STD", "t mm"}, "procedureTable");
  table_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  for (const int c : {1, 2, 3}) table_->setColumnWidth(c, c == 1 ? 60 : 50);
  table_->setToolTip("Millimetres, signed distance of the scan to the plan; click: its map");
  connect(table_, &QTableWidget::cellClicked, this, [this](int row, int) { show_procedure(row); });
  column->addWidget(table_, 1);
  facts_ = wrapped("");
  facts_->setObjectName("procedureFacts");
  column->addWidget(facts_);

  strip_ = new QWidget;
  auto* below = new QVBoxLayout(strip_);
  below->setContentsMargins(0, 0, 0, 0);
  charts_ = new QComboBox;
  charts_->setObjectName("chartBox");
  charts_->hide();  // until there are charts
  chart_ = new ChartView;
  chart_->setObjectName("evaluationChart");
  chart_->set_note("Error bars, radar, histograms and profiles appear when scans are evaluated.");
  below->addWidget(charts_);
  below->addWidget(chart_, 1);
  strip_->setMinimumHeight(310);
  connect(charts_, qOverload<int>(&QComboBox::currentIndexChanged), this, [this] { show_chart(); });
  document().opened.add([this] { opened(); });
}

QWidget* EvaluatePanel::make_scans() {
  auto* box = new QWidget;
  auto* grid = new QGridLayout(box);
  grid->setContentsMargins(0, 0, 0, 0);
  grid->setVerticalSpacing(3);
  const auto row = [&](int r, const char* name, const char* object) {
    auto* edit = new QLineEdit;
    edit->setObjectName(object);
    edit->setPlaceholderText("STL, PLY or OBJ");
    grid->addWidget(new QLabel(name), r, 0);
    grid->addWidget(edit, r, 1);
    auto* pick = button("…", QString(object) + "Pick", "Choose a file", [this, edit] {
      choose_file(this, "Scan", case_folder(), "Meshes (*.stl *.ply *.obj)",
                  [edit](const QString& path) { edit->setText(path); });
    });
    pick->setFixedWidth(30);
    grid->addWidget(pick, r, 2);
    return edit;
  };
  splint_ = row(0, "Splint in place", "scanSplint");
  maxilla_ = row(1, "Upper jaw", "scanMaxilla");
  mandible_ = row(2, "Lower jaw, biting", "scanMandible");
  auto* go = button("Evaluate", "evaluateScans", "The scans above, or those of the case's evaluation.toml",
                    [this] { evaluate(); });
  go->setProperty("role", "primary");
  auto* print = button("Virtual print", "virtualPrint",
                       "What the procedures would find on one simulated print, seating and scan",
                       [this] { run_virtual_print(); });
  auto* buttons = new QHBoxLayout;
  buttons->setSpacing(6);
  buttons->addWidget(go);
  buttons->addWidget(print);
  grid->addLayout(buttons, 3, 0, 1, 3);
  return box;
}

void EvaluatePanel::opened() {
  found_.reset();
  figures_.clear();
  charts_->clear();
  charts_->hide();
  table_->setRowCount(0);
  facts_->clear();
  chart_->set_note("Error bars, radar, histograms and profiles appear when scans are evaluated.");
  status_->show_state({}, absences());
}

void EvaluatePanel::run(const QString& name, std::function<void(JobContext&, Found&)> work) {
  if (bench_.jobs.busy()) return document().report("A job is running already: wait for it, or cancel it.");
  auto found = std::make_shared<Found>();
  bench_.jobs.run(
      name,
      [found, work = std::move(work)](JobContext& context) {
        work(context, *found);
        if (!found->trouble.empty()) return;
        found->range_mm = map_range_mm(found->splints);
        found->figures = overview_figures(found->tables);
        for (const SplintEvaluation& s : found->splints) {
          for (auto& f : distance_histograms(s, found->range_mm)) found->figures.push_back(std::move(f));
          for (auto& f : profile_figures(s)) found->figures.push_back(std::move(f));
        }
      },
      [this, found, content = document().shared_content()](bool cancelled) {
        if (cancelled || document().shared_content() != content) return;
        if (!found->trouble.empty()) return document().report(QString::fromStdString(found->trouble));
        show_found(found);
      });
}

/// Of a case that is the daemon's: it keeps a report in evaluations/; the maps are measured here then.
void EvaluatePanel::evaluate() {
  if (!document().is_open()) return;
  const auto path = [](const QLineEdit* e) { return std::filesystem::path(e->text().toStdString()); };
  if (!bench_.daemon.serves_case() || path(splint_).empty()) return run_scans();
  const auto request = evaluate_request(document().content(), path(splint_), path(maxilla_), path(mandible_));
  if (!request) {
    document().notice(QString::fromStdString(request.error().why) + ": evaluated here, not by the daemon.");
    return run_scans();
  }
  bench_.daemon.submit(*request, [this](const client::Job& job) {
    if (job.state == client::JobState::kDone || job.state == client::JobState::kGateFailed) run_scans();
  });
}

void EvaluatePanel::run_scans() {
  const auto content = document().shared_content();
  const auto path = [](const QLineEdit* e) { return std::filesystem::path(e->text().toStdString()); };
  EvaluateSplint scans;
  scans.name = content->title;
  scans.design = content->results();
  scans.maxilla = content->files.maxilla_mi;
  scans.mandible = content->files.mandible_mi;
  scans.transform = content->results() / "T_th.json";
  scans.scan_splint = path(splint_);
  scans.scan_maxilla = path(maxilla_);
  scans.scan_mandible = path(mandible_);
  const bool given =
      !scans.scan_splint.empty() || !scans.scan_mandible.empty() || !scans.scan_maxilla.empty();
  if (!given && content->evaluation.empty())
    return document().report("Name the scans first, or try a virtual print.");
  run("Evaluating the scans", [content, scans, given](JobContext& context, Found& found) {
    EvaluateJob job;
    if (given) {
      job.splints = {scans};
    } else {
      auto read = read_evaluation_file(content->evaluation);
      if (!read) return void(found.trouble = read.error().line());
      job = std::move(*read);
    }
    job.pictures = false;
    const auto scratch =
        std::filesystem::temp_directory_path() / ("gnathion_viewer_evaluation_" + std::to_string(::getpid()));
    std::filesystem::create_directories(scratch);
    auto outcome = run_evaluation(job, scratch, context);
    std::error_code ec;
    std::filesystem::remove_all(scratch, ec);
    if (!outcome) return void(found.trouble = outcome.error().line());
    found.splints = std::move(outcome->splints);
    found.tables = std::move(outcome->tables);
    found.notes = std::move(outcome->notes);
    found.source = "scans";
  });
}

void EvaluatePanel::run_virtual_print() {
  const Layer* splint = document().layers().find("splint");
  const auto content = document().shared_content();
  if (!splint || !document().state().therapeutic)
    return document().report("There is no splint to print yet: build one in the Design step.");
  const bool lower = content->design && content->design->value("arch", std::string()) == "mandible";
  if (lower || document().state().arch == Arch::kMandible)
    return document().report(
        "The virtual print knows splints on the upper teeth; this one is worn on the lower.");
  PlannedSplint planned;
  planned.name = content->title;
  planned.splint = splint->mesh;
  planned.maxilla = content->mesh("maxilla_mi");
  planned.mandible_mi = content->mesh("mandible_mi");
  planned.therapeutic = Motion<Dental>(*document().state().therapeutic);
  run("Virtual print", [planned](JobContext& context, Found& found) {
    VirtualPrintOptions options;
    options.trials = 1;
    context.begin_step("printing, seating, scanning", 0.4);
    auto patient = prepare_patient(planned, options.evaluation);
    if (!patient) return void(found.trouble = patient.error().line());
    const VirtualTrial trial = virtual_trial(*patient, options, 0);
    context.begin_step("the six procedures", 0.6);
    SilentProgress silent;
    auto evaluated = evaluate_splint(trial.scanned, {}, options.evaluation, silent);
    if (!evaluated) return void(found.trouble = evaluated.error().line());
    found.splints.push_back(std::move(*evaluated));
    found.tables = tables_of(found.splints, options.statistics);
    found.source = "virtual print: simulated, not a scan of a print";
  });
}

void EvaluatePanel::show_found(std::shared_ptr<const Found> found) {
  found_ = std::move(found);
  range_mm_ = found_->range_mm;
  const auto number = [](double v) { return QString::number(v, 'f', 3).replace('-', QChar(0x2212)); };
  table_->setRowCount(0);
  if (!found_->splints.empty())
    for (const ProcedureResult& p : found_->splints.front().procedures) {
      const int row = table_->rowCount();
      table_->setRowCount(row + 1);
      table_->setItem(row, 0, cell(procedure_title(p.procedure)));
      table_->setItem(row, 1, cell(number(p.field.all.avg_mm), true));
      table_->setItem(row, 2, cell(number(p.field.all.std_mm), true));
      table_->setItem(row, 3, cell(p.motion ? number(p.motion->t_mm) : "", true));
    }
  charts_->blockSignals(true);
  charts_->clear();
  for (const EvaluationFigure& f : found_->figures)
    charts_->addItem(QString::fromStdString(f.file).replace('_', ' ').replace(
        0, 1, QString::fromStdString(f.file).left(1).toUpper()));
  charts_->blockSignals(false);
  charts_->setCurrentIndex(0);
  charts_->setVisible(charts_->count() > 0);
  show_chart();
  QStringList done = {"evaluated: " + QString::fromStdString(found_->source)};
  std::vector<Absence> missing;
  for (const std::string& n : found_->notes) missing.push_back({Step::kEvaluate, "Note", n, false});
  status_->show_state(done, missing);
  if (table_->rowCount() > 0) {
    table_->selectRow(0);
    show_procedure(0);
  }
}

void EvaluatePanel::show_procedure(int row) {
  if (!found_ || found_->splints.empty()) return;
  const ProcedureResult& p = found_->splints.front().procedures.at(static_cast<std::size_t>(row));
  std::vector<float> values = p.field.distance_mm;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!is_measured(p.field.use[i])) values[i] = std::numeric_limits<float>::quiet_NaN();
  Layer map;
  map.id = "evaluation_map";
  map.name = procedure_title(p.procedure);
  map.group = "Evaluation";
  map.mesh = p.field.scan;
  map.pose = p.field.dental_from_scan;
  map.colors = diverging_colors(values, range_mm_);
  map.width_2d_px = 2.0;
  map.color_2d = {0.85, 0.45, 0.0};
  document().layers().put(map);
  document().layers().set_visible("evaluation_map", true);
  bench_.scene.set_colour_scale(ColourScale{"scan to plan, mm", -range_mm_, range_mm_, true});
  QStringList lines = {QString("<b>%1</b>: mean %2 ± %3 mm over %4 points")
                           .arg(procedure_title(p.procedure))
                           .arg(p.field.all.avg_mm, 0, 'f', 3)
                           .arg(p.field.all.std_mm, 0, 'f', 3)
                           .arg(p.field.all.n)};
  if (p.motion)
    lines << QString("turned %1° ± %2°, shifted %3 ± %4 mm, at most %5 mm at tooth %6")
                 .arg(p.motion->alpha_deg, 0, 'f', 2)
                 .arg(p.motion->alpha_sigma_deg, 0, 'f', 2)
                 .arg(p.motion->t_mm, 0, 'f', 3)
                 .arg(p.motion->t_sigma_mm, 0, 'f', 3)
                 .arg(p.motion->max_tooth_mm, 0, 'f', 3)
                 .arg(p.motion->max_tooth_fdi);
  facts_->setText(lines.join("<br>"));
}

void EvaluatePanel::show_chart() {
  const int i = charts_->currentIndex();
  if (found_ && i >= 0 && i < static_cast<int>(found_->figures.size()))
    chart_->set_drawing(found_->figures[static_cast<std::size_t>(i)].drawing);
}

void EvaluatePanel::enter() {
  if (found_ && document().layers().find("evaluation_map"))
    bench_.scene.set_colour_scale(ColourScale{"scan to plan, mm", -range_mm_, range_mm_, true});
}

void EvaluatePanel::leave() {
  bench_.scene.set_colour_scale(std::nullopt);
}

}  // namespace gnathion
