#include "viewer/panels/calibrate_panel.h"

#include <QHBoxLayout>
#include <QHeaderView>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "calibration/chain_json.h"
#include "registration/align.h"
#include "rendering/charts.h"
#include "viewer/model/colour_maps.h"
#include "viewer/model/splint_maps.h"
#include "viewer/panels/daemon_row.h"

namespace gnathion {
namespace {

constexpr double kResidualRangeMm = 0.2, kReachMm = 1.5;

/// 1σ displacement over points that the covariance of a left perturbation forecasts, RMS, mm.
double at_points_mm(const Matrix6& covariance, const std::vector<Vector3>& points) {
  double sum = 0;
  for (const Vector3& p : points) sum += point_covariance(covariance, p).trace();
  return std::sqrt(sum / static_cast<double>(points.size()));
}

}  // namespace

CalibratePanel::CalibratePanel(Workbench& bench) : Panel(bench, Step::kCalibrate) {
  setObjectName("calibratePanel");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 8, 10, 8);
  column->addWidget(status_ = new StepStatus("calibrateStatus"));
  column->addWidget(new DaemonRow(bench_, Step::kCalibrate));
  column->addWidget(heading("Registrations"));
  column->addWidget(wrapped("Choose one to see the surfaces laid over each other.", true));
  registrations_ = plain_table({"What on what", "RMS", "Held out", "Cond."}, "registrationTable");
  registrations_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  for (const int c : {1, 2, 3}) registrations_->setColumnWidth(c, c == 3 ? 44 : c == 2 ? 68 : 46);
  registrations_->setMinimumHeight(140);
  connect(registrations_, &QTableWidget::cellClicked, this, [this](int row, int) { show_registration(row); });
  column->addWidget(registrations_, 1);
  facts_ = wrapped("");
  facts_->setObjectName("registrationFacts");
  column->addWidget(facts_);
  column->addWidget(heading("Errors of single views"));
  views_note_ = wrapped("", true);
  views_note_->setObjectName("viewErrorsNote");
  column->addWidget(views_note_);
  views_ = plain_table({"View", "RMS px", "Held out px"}, "viewErrors");
  views_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  column->addWidget(views_, 1);

  strip_ = new QWidget;
  auto* row = new QHBoxLayout(strip_);
  row->setContentsMargins(0, 0, 0, 0);
  row->addWidget(graph_ = new FramesView, 3);
  row->addWidget(histogram_ = new ChartView, 2);
  histogram_->setObjectName("residualHistogram");
  strip_->setMinimumHeight(260);
  graph_->edge_clicked = [this](std::size_t edge) {
    const FrameEdge& e = document().content().frames->edges()[edge];
    facts_->setText(QString("<b>%1</b><br>%2%3")
                        .arg(QString::fromStdString(e.name()).toHtmlEscaped(),
                             QString::fromStdString(e.source).toHtmlEscaped(),
                             e.date.empty() ? "" : ", " + QString::fromStdString(e.date)));
  };
  document().opened.add([this] { opened(); });
}

void CalibratePanel::opened() {
  const CaseContent& c = document().content();
  chain_.reset();
  if (c.chain)
    if (Result<Chain> chain = chain_from_json(*c.chain, "chain.json")) chain_ = std::move(*chain);
  graph_->set_graph(c.frames);
  histogram_->set_note("Choose a registration: its residuals appear here.");
  facts_->clear();
  list_registrations();
  show_views();
  QStringList done;
  if (chain_)
    done << QString("T_D: %1 mm RMS, %2 mm held out")
                .arg(chain_->bow_from_dental.rms_mm, 0, 'f', 3)
                .arg(chain_->bow_from_dental.held_out_mm, 0, 'f', 3);
  if (chain_ && chain_->tracked)
    done << QString("camera and scans agree to %1 mm (p %2)")
                .arg(chain_->tracked->therapeutic_mm, 0, 'f', 3)
                .arg(chain_->tracked->p_value, 0, 'f', 2);
  auto missing = absences();
  if (c.frames) {
    const auto loops = c.frames->loops();
    const auto open =
        std::count_if(loops.begin(), loops.end(), [](const FrameLoop& l) { return !l.consistent(); });
    QString line = QString("%1 registrations").arg(c.frames->edges().size());
    if (loops.size() == 1) line += open ? ", 1 loop" : ", 1 loop, it closes";
    if (loops.size() > 1) line += QString(", %1 loops%2").arg(loops.size()).arg(open ? "" : ", all close");
    done << line;
    if (open)
      missing.push_back(
          {Step::kCalibrate, "Loops", std::to_string(open) + " do not close: see the graph", true});
  }
  if (chain_)
    for (const std::string& w : chain_->warnings) missing.push_back({Step::kCalibrate, "Warning", w, true});
  status_->show_state(done, missing);
}

void CalibratePanel::list_registrations() {
  registrations_->setRowCount(0);
  rows_.clear();
  const auto add = [&](const std::string& id, const QString& name, const ChainPose* pose) {
    const int row = registrations_->rowCount();
    registrations_->setRowCount(row + 1);
    registrations_->setItem(row, 0, cell(name));
    const auto number = [](double v, int d) { return QString::number(v, 'f', d); };
    registrations_->setItem(row, 1, cell(pose ? number(pose->rms_mm, 3) : "", true));
    registrations_->setItem(row, 2, cell(pose ? number(pose->held_out_mm, 3) : "", true));
    registrations_->setItem(row, 3, cell(pose ? number(pose->condition, 1) : "", true));
    rows_.push_back(id);
  };
  const CaseContent& c = document().content();
  if (chain_) {
    add("bow", "Bow on lower teeth (T_D)", &chain_->bow_from_dental);
    if (chain_->has_faces) {
      add("face", "Face scan on bow (T_F)", &chain_->bow_from_face);
      add("face_teeth", "Face scan on teeth (T)", &chain_->dental_from_face);
    }
  }
  if (c.mesh("mandible_clutch") && c.mesh("mandible_mi")) add("clutch", "Clutch scan on teeth", nullptr);
  for (const int column : {1, 2}) registrations_->horizontalHeaderItem(column)->setToolTip("mm");
}

void CalibratePanel::show_registration(int row) {
  const CaseContent& c = document().content();
  const std::string id = rows_.at(static_cast<std::size_t>(row));
  for (const char* layer : {"overlay_source", "overlay_target"}) document().layers().remove(layer);
  bench_.scene.clear_overlay("weak");
  facts_->clear();
  const SharedMesh bow = c.mesh("bow"), face = c.mesh("face_mi"), lower = c.mesh("mandible_mi");
  if (id == "clutch") {
    overlay("Clutch scan", c.mesh("mandible_clutch"), lower, Rigid3::identity(), std::nullopt, "clutch");
  } else if (id == "bow" && bow) {
    // The scan with the clutch on shows bow and teeth in one: it is what T_D rests on.
    const Rigid3 dental_from_bow = chain_->bow_from_dental.value.inverse();
    show_weak(chain_->bow_from_dental, dental_from_bow);
    if (c.mesh("mandible_clutch"))
      overlay("Clutch scan", c.mesh("mandible_clutch"), bow, dental_from_bow, std::nullopt, "bow");
  } else if ((id == "face" || id == "face_teeth") && face && bow) {
    const bool teeth = id == "face_teeth";
    show_weak(teeth ? chain_->dental_from_face : chain_->bow_from_face,
              teeth ? Rigid3::identity() : chain_->bow_from_dental.value.inverse());
    overlay("Face scan", face, bow, chain_->bow_from_dental.value.inverse(), chain_->bow_from_face.value,
            "face");
  }
}

/// Arrows at incisal point and molars: the largest axis of each point's error, drawn 100 times.
void CalibratePanel::show_weak(const ChainPose& pose, const Rigid3& dental_from_to) {
  const CaseContent& c = document().content();
  if (!c.arch) return;
  const ArchRuler ruler(*c.arch);
  const std::vector<Vector3> points = {c.arch->incisal_mm, ruler.at(0.8 * ruler.s_min_mm()),
                                       ruler.at(0.8 * ruler.s_max_mm())};
  const Matrix6 ad = adjoint(dental_from_to);
  const Matrix6 covariance = ad * pose.covariance * ad.transpose();
  constexpr double kShown = 100.0;
  Overlay o;
  for (const Vector3& p : points) {
    const Eigen::SelfAdjointEigenSolver<Matrix3> axes(point_covariance(covariance, p));
    const double sigma = std::sqrt(std::max(0.0, axes.eigenvalues()(2)));
    Vector3 half = std::clamp(kShown * sigma, 3.0, 25.0) * axes.eigenvectors().col(2);
    if (half.dot(c.arch->up) < 0) half = -half;
    o.arrows.push_back({p, p + half, safe_palette::kVermilion});
    o.arrows.push_back({p, p - half, safe_palette::kVermilion});
    // Left and right molar lie behind each other in a side view: one label above its arrow, one below.
    const double end = &p == &points.back() ? -1.2 : 1.2;
    o.labels.push_back(
        {p + end * half, QString("±%1 mm").arg(sigma, 0, 'f', 3).toStdString(), {0.55, 0.2, 0.0}, 14, true});
  }
  bench_.scene.set_overlay("weak", std::move(o));
  bench_.scene.look_at(c.arch->origin_mm, 95);
  QStringList lines = {
      QString("<b>%1 mm</b> (1σ) forecast at the teeth; arrows show the weakest direction, 100 times.")
          .arg(at_points_mm(covariance, points), 0, 'f', 3)};
  for (const std::string& w : pose.weak) lines << QString::fromStdString(w).toHtmlEscaped();
  if (pose.weak.empty()) lines << "No direction is weak.";
  facts_->setText(lines.join("<br>"));
}

struct CalibratePanel::Overlaid {
  Rigid3 target_from_source;
  std::string trouble;
  std::vector<float> residual_mm;
};

void CalibratePanel::overlay(const QString& name, SharedMesh source, SharedMesh target,
                             const Rigid3& dental_from_target, std::optional<Rigid3> target_from_source,
                             const std::string& id) {
  if (!source || !target) return;
  histogram_->set_note("Measuring residuals…");
  auto found = std::make_shared<Overlaid>();
  bench_.jobs.run_latest(
      "overlay",
      [source, target, target_from_source, found, id](JobContext&) {
        if (target_from_source) {
          found->target_from_source = *target_from_source;
        } else {
          AlignOptions options;
          options.overlap = id == "bow" ? 0.25 : 0.4;
          options.name = "scan with the clutch";
          const Result<Alignment> fit = align_surfaces(*source, *target, options);
          if (!fit) return void(found->trouble = fit.error().why);
          found->target_from_source = fit->target_from_source;
        }
        found->residual_mm =
            difference_mm(transformed(found->target_from_source, *source), *target, kReachMm);
      },
      [this, id, name, source, target, dental_from_target, found, content = document().shared_content()] {
        if (document().shared_content() != content || !isVisible()) return;
        if (!found->trouble.empty()) return histogram_->set_note(QString::fromStdString(found->trouble));
        Layer map;
        map.id = "overlay_source";
        map.name = (name + ", residuals").toStdString();
        map.group = "Registration";
        map.mesh = source;
        map.pose = dental_from_target * found->target_from_source;
        map.colors = diverging_colors(found->residual_mm, kResidualRangeMm);
        map.in_section = true;
        document().layers().put(std::move(map));
        if (target != document().content().mesh("mandible_mi")) {
          Layer fixed;
          fixed.id = "overlay_target";
          fixed.name = "Bow as designed";
          fixed.group = "Registration";
          fixed.mesh = target;
          fixed.pose = dental_from_target;
          fixed.color_3d = {0.62, 0.70, 0.78};
          fixed.opacity = 0.3;
          document().layers().put(std::move(fixed));
        }
        // Faces whole; of the bow what lies at the teeth.
        if (id == "face") bench_.scene.fit();
        if (id != "face" && document().content().arch)
          bench_.scene.look_at(document().content().arch->origin_mm, 95);
        bench_.scene.set_colour_scale(ColourScale{"residual, mm", -kResidualRangeMm, kResidualRangeMm, true});
        std::vector<double> values;
        for (const float v : found->residual_mm)
          if (std::isfinite(v) && std::abs(v) < 0.5f) values.push_back(double(v));
        histogram_->set_drawing(std::make_shared<const Drawing>(
            histogram_chart(histogram_of(values, -kResidualRangeMm, kResidualRangeMm, 40), kResidualRangeMm,
                            "residual, mm", name.toStdString())));
      });
}

/// Camera calibrations of the case, where there are any.
void CalibratePanel::show_views() {
  views_->setRowCount(0);
  namespace fs = std::filesystem;
  const fs::path folder = document().content().folder;
  for (const fs::path& path :
       {folder / "camera.json", folder / "results" / "camera.json", folder / "rig.json"}) {
    const Result<nlohmann::json> j = read_json(path);
    if (!j || !j->is_object()) continue;
    std::vector<nlohmann::json> cameras;
    if (j->contains("cameras") && (*j)["cameras"].is_array())
      for (const auto& c : (*j)["cameras"]) cameras.push_back(c);
    else
      cameras.push_back(*j);
    for (const auto& camera : cameras) {
      if (!camera.is_object() || !camera.contains("views") || !camera["views"].is_array()) continue;
      for (const auto& v : camera["views"]) {
        if (!v.is_object() || !v.contains("rms_px") || !v["rms_px"].is_number()) continue;
        const int row = views_->rowCount();
        views_->setRowCount(row + 1);
        views_->setItem(row, 0, cell(QString::fromStdString(v.value("name", std::string("?")))));
        views_->setItem(row, 1, cell(QString::number(v["rms_px"].get<double>(), 'f', 3), true));
        const bool held = v.contains("held_out_px") && v["held_out_px"].is_number();
        views_->setItem(row, 2,
                        cell(held ? QString::number(v["held_out_px"].get<double>(), 'f', 3) : "", true));
      }
    }
  }
  const bool any = views_->rowCount() > 0;
  views_->setVisible(any);
  views_note_->setText(any ? "Reprojection errors of the camera calibration."
                           : "No camera calibration lies in this case. 'gnathion calibrate camera --out "
                             "CASE/camera.json' makes one from pictures of a board.");
}

void CalibratePanel::enter() {
  if (chain_ && registrations_->currentRow() < 0 && registrations_->rowCount() > 0) {
    registrations_->selectRow(0);
    show_registration(0);
  }
}

void CalibratePanel::leave() {
  bench_.scene.clear_overlay("weak");
  bench_.scene.set_colour_scale(std::nullopt);
}

}  // namespace gnathion
