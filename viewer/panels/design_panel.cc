#include "viewer/panels/design_panel.h"

#include <QCheckBox>
#include <QHBoxLayout>
#include <QHeaderView>
#include <QTabWidget>

#include <cmath>

#include <nlohmann/json.hpp>

#include "rendering/charts.h"

namespace gnathion {
namespace {

/// "wall_min_mm" as "Wall min" and " mm".
std::pair<QString, QString> gate_name(const std::string& name) {
  QString unit;
  QString text = QString::fromStdString(name);
  for (const auto& [ending, u] : {std::pair{"_mm2", " mm²"}, {"_mm3", " mm³"}, {"_mm", " mm"}, {"_deg", "°"}})
    if (text.endsWith(ending)) {
      text.chop(static_cast<int>(std::string(ending).size()));
      unit = u;
      break;
    }
  text.replace('_', ' ');
  text[0] = text[0].toUpper();
  return {text, unit};
}

}  // namespace

DesignPanel::DesignPanel(Workbench& bench) : Panel(bench, Step::kDesign) {
  setObjectName("designPanel");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 8, 10, 8);
  column->addWidget(status_ = new StepStatus("designStatus"));
  auto* row = new QHBoxLayout;
  build_ = button("Build splint", "buildSplint", "Full build with all gates; the window stays usable",
                  [this] { build(); });
  build_->setProperty("role", "primary");
  cancel_ = button("Cancel", "cancelBuild", "Stops the build; nothing half-made is left", [this] {
    bench_.jobs.cancel_all();
    bench_.daemon.cancel_kind("design");
    bench_.status("Cancelling: the running step ends first.");
  });
  cancel_->setEnabled(false);
  row->addWidget(build_, 2);
  row->addWidget(cancel_, 1);
  column->addLayout(row);
  preview_ = new QCheckBox("Preview while changing");
  preview_->setObjectName("previewBox");
  preview_->setToolTip("A coarse, unverified splint for the eye; only a full build is for printing");
  preview_note_ = wrapped("", true);
  preview_note_->setObjectName("previewNote");
  auto* preview_row = new QHBoxLayout;
  preview_row->addWidget(preview_);
  preview_row->addWidget(preview_note_, 1);
  column->addLayout(preview_row);
  tabs_ = new QTabWidget;
  tabs_->setObjectName("designTabs");
  tabs_->addTab(make_gates(), "Gates");
  tabs_->addTab(parameters_ = new ParameterPage(document()), "Parameters");
  auto* edit_page = new QWidget;
  auto* edit_column = new QVBoxLayout(edit_page);
  edit_column->setContentsMargins(6, 6, 6, 6);
  edit_column->addWidget(heading("Draw on the splint"));
  edit_column->addWidget(edits_ = new EditTools(bench_));
  edit_column->addWidget(heading("Margin on the crowns"));
  edit_column->addWidget(margins_ = new MarginTools(bench_));
  edit_column->addWidget(heading("Compare designs"));
  edit_column->addWidget(compare_ = new CompareTools(bench_));
  edit_column->addStretch();
  tabs_->addTab(edit_page, "Edit, compare");
  column->addWidget(tabs_, 1);
  connect(preview_, &QCheckBox::toggled, this, [this](bool on) {
    if (on) return preview();
    document().layers().remove("preview");
    preview_note_->clear();
    document().layers().set_visible("splint", true);
    if (isVisible()) pose_jaws();
  });
  document().opened.add([this] { opened(); });
  document().state_changed.add([this] {
    parameters_->show_values();
    show_state();
    if (isVisible()) pose_jaws();
    if (preview_->isChecked() && isVisible()) preview();
  });
  bench_.daemon.changed.add(
      [this] { build_->setText(bench_.daemon.serves_case() ? "Build splint (daemon)" : "Build splint"); });
  document().layers().changed.add([this](const std::string&, LayerChange change) {
    if (change == LayerChange::kLook && isVisible()) show_scale();
  });
}

QWidget* DesignPanel::make_gates() {
  auto* page = new QWidget;
  auto* column = new QVBoxLayout(page);
  column->setContentsMargins(6, 6, 6, 6);
  verdict_ = heading("");
  verdict_->setObjectName("designVerdict");
  verdict_->setWordWrap(true);
  column->addWidget(verdict_);
  gates_ = plain_table({"", "Gate", "Value", "Limit"}, "gateTable");
  gates_->setColumnWidth(0, 22);
  gates_->setColumnWidth(2, 82);
  gates_->setColumnWidth(3, 50);
  gates_->horizontalHeader()->setSectionResizeMode(1, QHeaderView::Stretch);
  gates_->setMinimumHeight(96);
  gates_->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Ignored);  // it takes what is left
  gates_->setToolTip("Click: go to its place");
  connect(gates_, &QTableWidget::cellClicked, this, [this](int row, int) { click_gate(row); });
  column->addWidget(gates_, 1);
  auto* marks = new QHBoxLayout;
  const auto box = [&](const char* name, const char* object, const char* tip) {
    auto* b = new QCheckBox(name);
    b->setObjectName(object);
    b->setToolTip(tip);
    connect(b, &QCheckBox::toggled, this, [this] { show_marks(); });
    marks->addWidget(b);
    return b;
  };
  numbers_ = box("Tooth numbers", "fdiBox", "FDI numbers over the crowns");
  margin_ = box("Margin", "marginBox", "The curve between inner and outer surface");
  apertures_ = box("Apertures", "aperturesBox", "Where the splint is open, with area");
  column->addLayout(marks);
  return page;
}

void DesignPanel::opened() {
  maps_.reset();
  teeth_.clear();
  on_lower_ = false;
  report_ = document().content().design;
  preview_->setChecked(false);
  const bool ready = document().content().arch.has_value();
  const bool building = bench_.daemon.running("design");
  build_->setEnabled(ready && !building);
  cancel_->setEnabled(building || bench_.jobs.busy());
  preview_->setEnabled(ready);
  show_gates();
  parameters_->show_values();
  show_state();
}

void DesignPanel::show_state() {
  if (!document().is_open()) return;
  QStringList done;
  std::vector<Absence> missing;
  const bool splint = document().layers().find("splint");
  for (const Absence& a : absences())
    if (!(splint && (a.what == "Splint" || (a.what == "Gates" && report_)))) missing.push_back(a);
  if (!document().state().therapeutic)
    missing.push_back({Step::kDesign, "T_th", "set it in the Transformation step", false});
  if (report_ && report_->contains("mesh") && (*report_)["mesh"].is_object()) {
    const auto& m = (*report_)["mesh"];
    const auto& t = report_->contains("thickness_mm") ? (*report_)["thickness_mm"] : m;
    done << QString("splint of %1 cm³, wall at least %2 mm")
                .arg(m.value("volume_mm3", 0.0) / 1000, 0, 'f', 2)
                .arg(t.value("min", 0.0), 0, 'f', 2);
  }
  status_->show_state(done, missing);
}

void DesignPanel::show_gates() {
  gates_->setRowCount(0);
  gate_names_.clear();
  if (!report_) {
    verdict_->setText("No verified design in this case yet. Build one.");
    return;
  }
  const auto text = [](const nlohmann::json& v) {
    if (!v.is_number()) return QString("–");
    const double d = v.get<double>();
    return QString::number(d, 'f', std::abs(d - std::round(d)) < 1e-9 ? 0 : 3).replace('-', QChar(0x2212));
  };
  const QString verdict = QString::fromStdString(report_->value("verdict", std::string("?")));
  verdict_->setText("Verdict: " + verdict);
  verdict_->setStyleSheet(verdict == "pass" ? "color:#00694d" : "color:#a01e14");
  const auto gates = report_->value("gates", nlohmann::json::array());
  std::vector<nlohmann::json> order;
  for (const bool failed : {true, false})
    for (const auto& g : gates)
      if (g.is_object() && g.value("pass", false) != failed) order.push_back(g);
  gates_->setRowCount(static_cast<int>(order.size()));
  for (int row = 0; row < gates_->rowCount(); ++row) {
    const auto& g = order[static_cast<std::size_t>(row)];
    gate_names_.push_back(g.value("name", std::string("?")));
    const auto [name, unit] = gate_name(gate_names_.back());
    gates_->setItem(row, 0, verdict_cell(g.value("pass", false), g.value("blocks", true)));
    gates_->setItem(row, 1, cell(name));
    gates_->setItem(row, 2, cell(text(g.contains("value") ? g["value"] : nlohmann::json()) + unit, true));
    gates_->setItem(row, 3, cell(text(g.contains("limit") ? g["limit"] : nlohmann::json()), true));
  }
  if (order.empty() && report_->contains("violated"))
    verdict_->setText("Verdict: " + verdict + " (not built)");
}

void DesignPanel::enter() {
  pose_jaws();
  edits_->show_edits(true);
  margins_->show_margins(true);
  compare_->refresh();
  show_marks();
  show_scale();
  if (!maps_) make_maps();
}

void DesignPanel::leave() {
  edits_->show_edits(false);
  margins_->show_margins(false);
  compare_->leave();
  document().layers().set_pose("maxilla", Rigid3::identity());
  for (const char* overlay : {"marks", "gate"}) bench_.scene.clear_overlay(overlay);
  bench_.scene.set_colour_scale(std::nullopt);
}

}  // namespace gnathion
