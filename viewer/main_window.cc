#include "viewer/main_window.h"

#include <QAction>
#include <QActionGroup>
#include <QApplication>
#include <QCloseEvent>
#include <QElapsedTimer>
#include <QLabel>
#include <QProgressBar>
#include <QScrollArea>
#include <QSplitter>
#include <QStackedWidget>
#include <QStatusBar>
#include <QTabBar>
#include <QToolButton>
#include <QVBoxLayout>

#include "viewer/panels/calibrate_panel.h"
#include "viewer/panels/design_panel.h"
#include "viewer/panels/evaluate_panel.h"
#include "viewer/panels/jobs_list.h"
#include "viewer/panels/motion_panel.h"
#include "viewer/panels/transform_panel.h"
#include "viewer/widgets/layer_panel.h"
#include "viewer/window_style.h"

namespace gnathion {

MainWindow::MainWindow(WindowOptions options) : options_(std::move(options)) {
  setObjectName("mainWindow");
  setWindowTitle("Gnathion (research use)");
  resize(1280, 800);
  setStyleSheet(window_style());
  auto* root = new QWidget;
  auto* column = new QVBoxLayout(root);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addWidget(messages_ = new MessageBar(root));
  steps_ = new QTabBar;
  steps_->setObjectName("steps");
  steps_->setExpanding(false);
  steps_->setDrawBase(false);
  QFont bold = font();
  bold.setBold(true);
  steps_->setFont(bold);
  column->addWidget(steps_);
  columns_ = new QSplitter(Qt::Horizontal);
  columns_->setChildrenCollapsible(false);
  column->addWidget(columns_, 1);
  setCentralWidget(root);

  make_centre();
  make_steps();
  make_right();
  columns_->setSizes({346, 638, 296});
  columns_->setStretchFactor(0, 0);
  columns_->setStretchFactor(1, 1);
  columns_->setStretchFactor(2, 0);
  make_toolbar();
  make_status();

  document_.error.add([this](const QString& line) { messages_->show_error(line); });
  document_.notice.add([this](const QString& line) { messages_->show_notice(line); });
  jobs_.failed.add([this](const QString& line) { messages_->show_error(line); });
  jobs_.changed.add([this] { show_job(); });
  document_.layers().changed.add([this](const std::string&, LayerChange) { cut(); });
  connect(steps_, &QTabBar::currentChanged, this, [this](int i) { go_to_step(i); });
  go_to_step(0);
}

MainWindow::~MainWindow() {
  if (measure_) measure_->end();
}

void MainWindow::make_centre() {
  scene_ = std::make_unique<Scene3d>(document_.layers(), jobs_, nullptr, "scene");
  second_ = std::make_unique<Scene3d>(second_layers_, jobs_, nullptr, "secondScene");
  bench_ = std::make_unique<Workbench>(
      Workbench{document_,
                jobs_,
                daemon_jobs_,
                *scene_,
                *second_,
                second_layers_,
                [this](bool shown) {
                  second_->widget()->setVisible(shown);
                  if (shown) pair_->setSizes({1000, 1000});  // halves
                  scene_->set_caption(shown ? "This design" : "");
                  if (shown)
                    second_->link_camera(*scene_);
                  else
                    second_->unlink_camera();
                },
                [this](const QString& line) { statusBar()->showMessage(line, 8000); },
                [this] { reload(); },
                {}});
  pair_ = new QSplitter(Qt::Horizontal);
  pair_->addWidget(scene_->widget());
  pair_->addWidget(second_->widget());
  second_->widget()->hide();
  empty_ = new QLabel(scene_->widget());
  empty_->setObjectName("emptyScene");
  empty_->setAlignment(Qt::AlignCenter);
  empty_->setWordWrap(true);
  empty_->setAttribute(Qt::WA_TransparentForMouseEvents);
  (new QVBoxLayout(scene_->widget()))->addWidget(empty_);  // in the middle, however large the scene is
  strips_ = new QStackedWidget;
  strips_->setObjectName("strip");
  centre_ = new QSplitter(Qt::Vertical);
  centre_->setChildrenCollapsible(false);
  centre_->addWidget(pair_);
  centre_->addWidget(strips_);
  centre_->setStretchFactor(0, 1);
  scene_->hovered.add([this](const std::optional<PickedPoint>& p) {
    if (!p) return coordinates_->setText("");
    const Layer* layer = document_.layers().find(p->layer);
    coordinates_->setText(QString("%1   x %2   y %3   z %4 mm")
                              .arg(layer ? QString::fromStdString(layer->name) : "")
                              .arg(p->at_mm.x(), 0, 'f', 2)
                              .arg(p->at_mm.y(), 0, 'f', 2)
                              .arg(p->at_mm.z(), 0, 'f', 2));
  });
  scene_->plane_moved.add([this](const SectionPlane&) { cut(); });
}

void MainWindow::make_steps() {
  panels_ = new QStackedWidget;
  panels_->setMinimumWidth(362);
  auto* motion = new MotionPanel(*bench_);
  auto* transform = new TransformPanel(*bench_);
  transform->from_motion = [motion] { return motion->picked_position(); };
  transform->films().height_changed = [this] {
    if (step_ == static_cast<int>(Step::kTransformation)) fit_strip();
  };
  panel_of_ = {new CapturePanel(*bench_, options_.connect, options_.socket),
               motion,
               new CalibratePanel(*bench_),
               transform,
               new DesignPanel(*bench_),
               new EvaluatePanel(*bench_)};
  for (Panel* panel : panel_of_) {
    auto* scroll = new QScrollArea;
    scroll->setWidget(panel);
    scroll->setWidgetResizable(true);
    scroll->setFrameShape(QFrame::NoFrame);
    scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
    panels_->addWidget(scroll);
    strips_->addWidget(panel->strip() ? panel->strip() : new QWidget);
    const int i = steps_->addTab(QString("%1  %2").arg(steps_->count() + 1).arg(step_name(panel->step())));
    steps_->setTabToolTip(i, QString("Ctrl+%1").arg(i + 1));
  }
  auto* left = new QWidget;
  left->setObjectName("leftColumn");
  auto* column = new QVBoxLayout(left);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addWidget(panels_, 1);
  column->addWidget(new JobsList(daemon_jobs_));
  columns_->addWidget(left);
  columns_->addWidget(centre_);
}

void MainWindow::make_right() {
  auto* right = new QSplitter(Qt::Vertical);
  right->setChildrenCollapsible(false);
  layer_panel_ = new LayerPanel(document_.layers());
  layer_panel_->set_groups({"Patient", "Bone", "Design", "Maps", "Compared", "Registration", "Evaluation"});
  auto* scroll = new QScrollArea;
  scroll->setWidget(layer_panel_);
  scroll->setWidgetResizable(true);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  auto* below = new QWidget;
  below->setObjectName("sectionBox");
  auto* column = new QVBoxLayout(below);
  column->setContentsMargins(6, 4, 6, 4);
  column->addWidget(heading("Cross-section"));
  section_ = new ProfilePlot;
  section_->setObjectName("section");
  section_->set_axes("mm", "mm");
  section_->set_note("Press C, then drag the blue plane through the teeth.");
  column->addWidget(section_, 1);
  right->addWidget(scroll);
  right->addWidget(below);
  right->setSizes({390, 310});
  right->setMinimumWidth(296);
  columns_->addWidget(right);
}

// --- a case -----------------------------------------------------------------------------------------------

void MainWindow::open(const std::filesystem::path& folder) {
  if (loading_) {
    waiting_ = folder;
    return;
  }
  loading_ = true;
  empty_->setText("Opening " + QString::fromStdString(folder.filename().string()) + " …");
  auto clock = std::make_shared<QElapsedTimer>();
  clock->start();
  auto content = std::make_shared<std::shared_ptr<const CaseContent>>();
  jobs_.run_latest(
      "open", [folder, content](JobContext&) { *content = load_case(folder); },
      [this, content, clock] {
        loading_ = false;
        show_case(*content);
        // Surfaces come in as they are ready; the case is open when all that show are drawn.
        auto* watch = new QTimer(this);
        watch->setInterval(10);
        connect(watch, &QTimer::timeout, this, [this, watch, clock] {
          if (!scene_->settled()) return;
          open_s_ = static_cast<double>(clock->elapsed()) / 1000.0;
          watch->deleteLater();
        });
        watch->start();
        if (!waiting_.empty()) open(std::exchange(waiting_, {}));
      });
}

void MainWindow::show_case(std::shared_ptr<const CaseContent> content) {
  if (step_ >= 0 && document_.is_open()) panel_of_[static_cast<std::size_t>(step_)]->leave();
  bench_->tool_taken(nullptr);
  step_ = -1;  // what another case showed is not this one's
  shown_.clear();
  messages_->hide();
  setWindowTitle(QString("%1 – Gnathion (research use)").arg(QString::fromStdString(content->title)));
  document_.open(content);
  put_patient_layers(document_);
  if (document_.layers().layers().empty())
    empty_->setText(
        std::filesystem::exists(content->files.toml())
            ? "There is nothing to show in this case yet.\nThe steps on the left say what is missing."
            : "This folder is not a case yet.\n'gnathion case import SCANS CASE' makes one of a folder "
              "of scans.");
  else
    empty_->clear();
  start_section();
  // The step where the work stands: the last one that has something.
  const int step = content->mesh("splint") ? 4
                   : content->therapeutic  ? 3
                   : content->chain        ? 2
                   : content->motion       ? 1
                                           : 0;
  if (steps_->currentIndex() == step) go_to_step(step);
  steps_->setCurrentIndex(step);
  look("oblique");
  std::size_t broken = 0;
  QString first;
  for (const Absence& a : content->absences)
    if (a.broken && !broken++) first = QString::fromStdString(a.what + ": " + a.why);
  if (broken)
    messages_->show_error(
        QString("Opened with what is there. %1%2")
            .arg(first, broken > 1 ? QString(" (and %1 more, see the steps)").arg(broken - 1) : ""));
}

/// The folder has changed under the window, by a job: the same step, camera and layers, with what is there
/// now.
void MainWindow::reload() {
  if (loading_ || !document_.is_open()) return;
  loading_ = true;
  auto content = std::make_shared<std::shared_ptr<const CaseContent>>();
  jobs_.run_latest(
      "open", [folder = document_.content().folder, content](JobContext&) { *content = load_case(folder); },
      [this, content] {
        loading_ = false;
        if (!waiting_.empty()) return open(std::exchange(waiting_, {}));
        const int step = step_;
        keep_shown();
        panel_of_[static_cast<std::size_t>(step)]->leave();
        step_ = -1;
        document_.refresh(*content);
        put_patient_layers(document_);
        go_to_step(step);
      });
}

/// What the step shows, with the tools put down: some hide layers while they are held.
void MainWindow::keep_shown() {
  bench_->tool_taken(nullptr);
  std::map<std::string, bool> now;
  for (const Layer& l : document_.layers().layers()) now[l.id] = l.visible;
  shown_[static_cast<Step>(step_)] = std::move(now);
}

/// The strip is as high as its step wants it; a stack alone would take the highest of all.
void MainWindow::fit_strip() {
  const QWidget* strip = step_ < 0 ? nullptr : panel_of_[static_cast<std::size_t>(step_)]->strip();
  if (!strip) return;
  strips_->setMinimumHeight(strip->minimumHeight());
  strips_->setMaximumHeight(strip->maximumHeight());
  centre_->setSizes({height() - strip->minimumHeight() - 120, strip->minimumHeight()});
}

void MainWindow::go_to_step(int step) {
  if (step == step_ || step < 0) return;
  if (step_ >= 0) {
    keep_shown();
    panel_of_[static_cast<std::size_t>(step_)]->leave();
  }
  step_ = step;
  panels_->setCurrentIndex(step);
  strips_->setCurrentIndex(step);
  QWidget* strip = panel_of_[static_cast<std::size_t>(step)]->strip();
  strips_->setVisible(strip != nullptr);
  fit_strip();
  if (!document_.is_open()) {
    if (step == 0) panel_of_[0]->enter();
    return;
  }
  apply_layers(static_cast<Step>(step));
  panel_of_[static_cast<std::size_t>(step)]->enter();
  scene_->refit();
}

/// Each step shows what it is about; what the user chose there comes back.
void MainWindow::apply_layers(Step step) {
  const std::set<std::string> first = panel_of_[static_cast<std::size_t>(step)]->first_layers();
  const auto known = shown_.find(step);
  std::vector<std::string> ids;
  for (const Layer& l : document_.layers().layers()) ids.push_back(l.id);
  for (const std::string& id : ids) {
    bool on = first.count(id) > 0;
    // Without T_th the lower jaw still shows, where it is known.
    if (id == "mandible_mi" && first.count("mandible_tp") && !document_.state().therapeutic) on = true;
    if (known != shown_.end() && known->second.count(id)) on = known->second.at(id);
    document_.layers().set_visible(id, on);
  }
  const auto& t = document_.state().therapeutic;
  const bool in_tp = step == Step::kTransformation || step == Step::kDesign || step == Step::kEvaluate;
  for (const char* id : {"condyle_left", "condyle_right"})
    document_.layers().set_pose(id, in_tp && t ? *t : Rigid3::identity());
}

void MainWindow::closeEvent(QCloseEvent* event) {
  document_.save();
  jobs_.cancel_all();
  event->accept();
}

// --- the section ------------------------------------------------------------------------------------------

void MainWindow::start_section() {
  SectionPlane plane;
  const CaseContent& c = document_.content();
  Vector3 up = Vector3::UnitZ();
  if (c.arch) {
    const ArchRuler ruler(*c.arch);
    const double s_mm = 0.75 * ruler.s_max_mm();  // among the left molars
    up = c.arch->up;
    plane = {ruler.at(s_mm), ruler.outward(s_mm), up};
  } else if (!document_.layers().layers().empty()) {
    plane.origin_mm = bounding_box(*document_.layers().layers().front().mesh).centre_mm();
  }
  section_fitted_ = false;
  scene_->set_plane(plane, up);
}

/// Cuts what shows, in the background, the newest plane first.
void MainWindow::cut() {
  if (!plane_on_ || !document_.is_open()) return;
  struct Cut {
    PlotCurve look;
    std::shared_ptr<const TriangleMesh> mesh;
    Rigid3 mesh_from_dental;
  };
  auto cuts = std::make_shared<std::vector<Cut>>();
  for (const Layer& l : document_.layers().layers())
    if (l.visible && l.in_section && l.mesh)
      cuts->push_back({{l.name, l.color_2d, l.width_2d_px, {}}, l.mesh, l.pose.inverse()});
  jobs_.run_latest(
      "section",
      [cuts, plane = scene_->plane()](JobContext& context) {
        for (Cut& c : *cuts) {
          context.throw_if_cancelled();
          c.look.lines = cut_mesh(
              *c.mesh, {c.mesh_from_dental * plane.origin_mm, c.mesh_from_dental.rotation * plane.x_axis,
                        c.mesh_from_dental.rotation * plane.y_axis});
        }
      },
      [this, cuts] {
        std::vector<PlotCurve> curves;
        for (Cut& c : *cuts) curves.push_back(std::move(c.look));
        section_->set_curves(std::move(curves));
        if (!section_fitted_) section_->look_at({0, 0}, 15);
        section_fitted_ = true;
      });
}

}  // namespace gnathion
