#include "viewer/panels/design_panel.h"

#include <QCheckBox>
#include <QElapsedTimer>
#include <QHBoxLayout>
#include <QHeaderView>
#include <QTabWidget>

#include <cmath>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "pipeline/design_job.h"
#include "rendering/charts.h"
#include "viewer/model/colour_maps.h"
#include "viewer/model/daemon_requests.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
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

fs::path next_design_folder(const fs::path& folder) {
  std::error_code ec;
  for (int i = 1;; ++i) {
    const fs::path at = folder / "designs" / QString("design_%1").arg(i, 3, 10, QChar('0')).toStdString();
    if (!fs::exists(at, ec)) return at;
  }
}

/// What a design is made from; copies the jaws, so in the background.
SplintInputs inputs_of(const CaseContent& c, const SessionState& s) {
  SplintInputs in;
  in.maxilla = *c.mesh("maxilla_mi");
  in.mandible_mi = *c.mesh("mandible_mi");
  in.therapeutic = Motion<Dental>(*s.therapeutic);
  in.arch = s.arch;
  in.edits = s.edits;
  return in;
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
  preview_timer_.setSingleShot(true);
  preview_timer_.setInterval(60);
  connect(&preview_timer_, &QTimer::timeout, this, [this] { preview(); });
  connect(preview_, &QCheckBox::toggled, this, [this](bool on) {
    if (on) return preview();
    document().layers().remove("preview");
    preview_note_->clear();
    document().layers().set_visible("splint", true);
  });
  document().opened.add([this] { opened(); });
  document().state_changed.add([this] {
    parameters_->show_values();
    show_state();
    if (preview_->isChecked() && isVisible()) preview_timer_.start();
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

void DesignPanel::preview() {
  if (!document().is_open() || !document().state().therapeutic || !document().content().arch) {
    preview_note_->setText("needs T_th");
    return;
  }
  preview_note_->setText("updating…");
  auto made = std::make_shared<std::shared_ptr<const TriangleMesh>>();
  auto trouble = std::make_shared<std::string>();
  auto timer = std::make_shared<QElapsedTimer>();
  timer->start();
  bench_.jobs.run_latest(
      "preview",
      [previewer = previewer_, content = document().shared_content(), state = document().state(), made,
       trouble](JobContext&) {
        auto preview = previewer->build(inputs_of(*content, state), state.parameters);
        if (preview)
          *made = std::make_shared<const TriangleMesh>(std::move(preview->splint));
        else
          *trouble = preview.error().why;
      },
      [this, made, trouble, timer] {
        if (!preview_->isChecked()) return;
        if (!*made) return preview_note_->setText(QString::fromStdString(*trouble));
        Layer layer;
        layer.id = "preview";
        layer.name = "Preview, not verified";
        layer.group = "Design";
        layer.mesh = *made;
        layer.color_3d = {0.80, 0.62, 0.78};
        layer.color_2d = safe_palette::kPurple;
        layer.width_2d_px = 2.0;
        layer.opacity = 0.85;
        document().layers().set_visible("splint", false);
        document().layers().put(std::move(layer));
        preview_note_->setText(
            QString("%1 s").arg(static_cast<double>(timer->elapsed()) / 1000.0, 0, 'f', 2));
      });
}

void DesignPanel::build() {
  const auto content = document().shared_content();
  if (!document().state().therapeutic)
    return document().report("T_th is not set yet: set it in the Transformation step.");
  if (bench_.daemon.serves_case()) return build_by_daemon();
  if (bench_.jobs.busy()) return document().report("A job is running already: wait for it, or cancel it.");
  const SessionState state = document().state();
  const fs::path target = next_design_folder(content->folder);
  build_->setEnabled(false);
  cancel_->setEnabled(true);
  auto trouble = std::make_shared<std::string>();
  bench_.jobs.run(
      "Building the splint",
      [content, state, target, trouble](JobContext& context) {
        const auto build_into = [&]() -> Status {
          std::error_code ec;
          fs::create_directories(target.parent_path(), ec);
          GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(target, false));
          const fs::path transform = staged.path() / "T_th.json";
          GNATHION_CHECK_OK(
              write_json(transform, motion_json(Motion<Dental>(*state.therapeutic), std::nullopt,
                                                {{"from", state.therapeutic_source}})));
          DesignJob job;
          job.maxilla = content->files.maxilla_mi;
          job.mandible = content->files.mandible_mi;
          job.transform = transform;
          job.shown_folder = content->folder;
          job.shown_transform = fs::path("designs") / target.filename() / "T_th.json";
          job.arch = state.arch;
          job.edits = state.edits;
          job.parameters = state.parameters;
          job.pictures = false;  // off-screen pictures need the one OpenGL thread that the window has
          GNATHION_TRY(const DesignOutcome outcome, run_design(job, staged.path(), context));
          context.throw_if_cancelled();
          return staged.commit();
        };
        if (const Status done = build_into(); !done) *trouble = done.error().line();
      },
      [this, target, trouble](bool cancelled) { built(target, cancelled, *trouble); });
}

/// The case is the daemon's: its processes compute, the window only follows.
void DesignPanel::build_by_daemon() {
  const auto request = design_request(document().content(), document().state());
  if (!request) return document().report(QString::fromStdString(request.error().line()));
  build_->setEnabled(false);
  cancel_->setEnabled(true);
  bench_.daemon.submit(
      *request, [this, target = document().content().folder / output_of(*request)](const client::Job& job) {
        build_->setEnabled(document().content().arch.has_value());
        cancel_->setEnabled(false);
        const bool made = job.state == client::JobState::kDone || job.state == client::JobState::kGateFailed;
        if (made && target.parent_path().parent_path() == document().content().folder)
          built(target, false, "");
      });
}

void DesignPanel::built(const fs::path& folder, bool cancelled, const std::string& trouble) {
  build_->setEnabled(true);
  cancel_->setEnabled(false);
  if (cancelled) return bench_.status("The build was cancelled; nothing was written.");
  if (!trouble.empty()) return document().report(QString::fromStdString(trouble));
  auto mesh = std::make_shared<std::shared_ptr<const TriangleMesh>>();
  auto report = std::make_shared<std::shared_ptr<const nlohmann::json>>();
  bench_.jobs.run_latest(
      "read design",
      [folder, mesh, report](JobContext&) {
        for (const char* file : {"splint.stl", "splint.rejected.stl"})
          if (auto m = read_mesh(folder / file)) *mesh = std::make_shared<const TriangleMesh>(std::move(*m));
        if (auto j = read_json(folder / "design.json"))
          *report = std::make_shared<const nlohmann::json>(std::move(*j));
      },
      [this, mesh, report, folder] {
        report_ = *report;
        show_gates();
        if (*mesh) {
          Layer layer;
          layer.id = "splint";
          layer.name = "Splint";
          layer.group = "Design";
          layer.mesh = *mesh;
          layer.color_3d = palette::kSplintClear;
          layer.color_2d = palette::kSplint;
          layer.width_2d_px = 2.4;
          layer.opacity = 0.8;
          document().layers().put(std::move(layer));
          document().layers().set_visible("splint", true);
          preview_->setChecked(false);
          make_maps();
        }
        compare_->refresh();
        show_state();
        document().notice("Built: designs/" + QString::fromStdString(folder.filename().string()));
      });
}

/// Inner and outer surface, thickness, undercut, numbers: measured once a splint, in the background.
void DesignPanel::make_maps() {
  const Layer* splint = document().layers().find("splint");
  const CaseContent& c = document().content();
  if (!splint || !c.arch || !document().state().therapeutic) return;
  struct Made {
    SplintMaps maps;
    std::vector<float> undercut;
    std::vector<ToothLabel> teeth;
  };
  auto made = std::make_shared<Made>();
  const bool upper = document().state().arch == Arch::kMaxilla;
  const Rigid3 t = *document().state().therapeutic;
  bench_.jobs.run_latest(
      "maps",
      [mesh = splint->mesh, content = document().shared_content(), upper, t, made](JobContext& context) {
        const TriangleMesh &maxilla = *content->mesh("maxilla_mi"), &mandible = *content->mesh("mandible_mi");
        const Arch worn = upper ? Arch::kMaxilla : Arch::kMandible;
        const TriangleMesh& support = upper ? maxilla : mandible;
        made->maps = splint_maps(*mesh, support,
                                 transformed(upper ? t : t.inverse(), upper ? mandible : maxilla), context);
        made->undercut = undercut_deg(support, content->arch->gingival(worn));
        made->teeth = tooth_labels(maxilla, *content->arch, Arch::kMaxilla);
        for (ToothLabel l : tooth_labels(mandible, *content->arch, Arch::kMandible)) {
          l.at_mm = t * l.at_mm;
          made->teeth.push_back(l);
        }
      },
      [this, made, mesh = splint->mesh] {
        const Layer* now = document().layers().find("splint");
        if (now && now->mesh == mesh) put_maps(made->maps, made->undercut, made->teeth);
      });
}

void DesignPanel::put_maps(const SplintMaps& maps, const std::vector<float>& undercut,
                           const std::vector<ToothLabel>& teeth) {
  maps_ = std::make_shared<const SplintMaps>(maps);
  teeth_ = teeth;
  const Layer splint = *document().layers().find("splint");
  const auto put = [&](const char* id, const char* name, SharedMesh mesh, Color color_3d, Color color_2d,
                       std::shared_ptr<const VertexColors> colors, bool in_section) {
    if (!mesh || mesh->empty()) return;
    Layer l;
    l.id = id;
    l.name = name;
    l.group = colors ? "Maps" : "Design";
    l.mesh = std::move(mesh);
    l.color_3d = color_3d;
    l.color_2d = color_2d;
    l.width_2d_px = 2.2;
    l.colors = std::move(colors);
    l.visible = false;
    l.in_section = in_section;
    document().layers().put(std::move(l));
  };
  put("inner", "Inner surface", maps.inner, {0.25, 0.36, 0.66}, palette::kInner, nullptr, true);
  put("outer", "Outer surface", maps.outer, {0.55, 0.76, 0.95}, palette::kOuter, nullptr, true);
  put("stamp", "Stamp (occlusal in TP)", maps.stamp, palette::kOcclusalTp, palette::kOcclusalTp, nullptr,
      true);
  put("thickness", "Thickness", splint.mesh, {0.42, 0.5, 0.47}, {}, ramp_colors(maps.thickness_mm, 0, 4),
      false);
  put("contacts", "Contacts and gap", splint.mesh, {0.7, 0.6, 0.5}, {}, diverging_colors(maps.gap_mm, 0.5),
      false);
  const bool upper = document().state().arch == Arch::kMaxilla;
  if (const Layer* support = document().layers().find(upper ? "maxilla" : "mandible_mi"))
    put("undercut", "Undercut", support->mesh, {0.84, 0.5, 0.2}, {}, diverging_colors(undercut, 45), false);
  show_marks();
}

/// The scale of the map that shows, if one does.
void DesignPanel::show_scale() {
  const LayerModel& layers = document().layers();
  if (layers.shows("thickness"))
    bench_.scene.set_colour_scale(ColourScale{"thickness, mm", 0, 4, false});
  else if (layers.shows("contacts"))
    bench_.scene.set_colour_scale(ColourScale{"gap, mm", -0.5, 0.5, true});
  else if (layers.shows("undercut"))
    bench_.scene.set_colour_scale(ColourScale{"undercut, °", -45, 45, true});
  else if (!layers.shows("difference"))
    bench_.scene.set_colour_scale(std::nullopt);
}

void DesignPanel::show_marks() {
  Overlay o;
  if (isVisible() && numbers_->isChecked())
    for (const ToothLabel& t : teeth_)
      o.labels.push_back({t.at_mm, std::to_string(t.fdi), {0.08, 0.14, 0.3}, 14, true});
  if (isVisible() && margin_->isChecked() && maps_)
    for (const auto& curve : maps_->margin_mm) o.lines.push_back({curve, safe_palette::kVermilion, 3});
  if (isVisible() && apertures_->isChecked() && report_ && report_->contains("apertures")) {
    for (const auto& a : (*report_)["apertures"]) {
      if (!a.is_object() || !a.contains("centre_mm") || a["centre_mm"].size() != 3) continue;
      const Vector3 at(a["centre_mm"][0].get<double>(), a["centre_mm"][1].get<double>(),
                       a["centre_mm"][2].get<double>());
      o.balls.push_back({at, safe_palette::kPurple, 0.7});
      o.labels.push_back({at,
                          QString("%1 mm²").arg(a.value("area_mm2", 0.0), 0, 'f', 1).toUtf8().toStdString(),
                          {0.3, 0.1, 0.3},
                          14,
                          true});
    }
    if ((*report_)["apertures"].empty()) bench_.status("This design has no apertures.");
  }
  if (o.labels.empty() && o.lines.empty() && o.balls.empty())
    bench_.scene.clear_overlay("marks");
  else
    bench_.scene.set_overlay("marks", std::move(o));
}

/// Where a gate's figure was measured, as far as the surface tells.
Vector3 DesignPanel::place_of(const std::string& gate) const {
  const Layer* splint = bench_.document.layers().find("splint");
  const auto& vertices = splint->mesh->vertices_mm;
  const auto least = [&](const std::vector<float>& values) {
    std::size_t best = 0;
    float low = 1e30f;
    for (std::size_t i = 0; i < values.size(); ++i)
      if (values[i] < low) low = values[i], best = i;
    return vertices[best];
  };
  if (gate.find("wall") != std::string::npos && report_->contains("thickness_mm")) {
    const auto& t = (*report_)["thickness_mm"];
    if (t.contains("where_mm") && t["where_mm"].is_array() && t["where_mm"].size() == 3)
      return Vector3(t["where_mm"][0].get<double>(), t["where_mm"][1].get<double>(),
                     t["where_mm"][2].get<double>());
  }
  if (!maps_) return bounding_box(*splint->mesh).centre_mm();
  if (gate.rfind("maxilla", 0) == 0) return least(maps_->seat_mm);
  if (gate.rfind("contacts_left", 0) == 0 || gate.rfind("contacts_right", 0) == 0) {
    const ArchFrame& arch = *bench_.document.content().arch;
    const double side = gate.find("left") != std::string::npos ? 1 : -1;
    Vector3 sum = Vector3::Zero();
    double n = 0;
    for (std::size_t i = 0; i < vertices.size(); ++i)
      if (std::abs(maps_->gap_mm[i]) < 0.05f && side * arch.left.dot(vertices[i] - arch.origin_mm) > 0)
        sum += vertices[i], n += 1;
    if (n > 0) return sum / n;
  }
  return least(maps_->gap_mm);
}

void DesignPanel::click_gate(int row) {
  if (!document().layers().find("splint")) return;
  const Vector3 at = place_of(gate_names_.at(static_cast<std::size_t>(row)));
  Overlay o;
  o.balls.push_back({at, safe_palette::kVermilion, 0.7});
  bench_.scene.set_overlay("gate", std::move(o));
  bench_.scene.look_at(at, 35);
  bench_.status(QString("%1 at %2, %3, %4 mm")
                    .arg(gates_->item(row, 1)->text())
                    .arg(at.x(), 0, 'f', 1)
                    .arg(at.y(), 0, 'f', 1)
                    .arg(at.z(), 0, 'f', 1));
}

void DesignPanel::enter() {
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
  for (const char* overlay : {"marks", "gate"}) bench_.scene.clear_overlay(overlay);
  bench_.scene.set_colour_scale(std::nullopt);
}

}  // namespace gnathion
