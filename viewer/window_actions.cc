// The window's toolbar, status line, shortcuts and named views.
#include <QAction>
#include <QActionGroup>
#include <QDateTime>
#include <QDir>
#include <QLabel>
#include <QProgressBar>
#include <QShortcut>
#include <QStatusBar>
#include <QTabBar>
#include <QTimer>
#include <QToolBar>
#include <QToolButton>
#include <QVBoxLayout>

#include "viewer/main_window.h"
#include "viewer/widgets/parts.h"
#include "viewer/window_style.h"

namespace gnathion {
namespace {

struct NamedView {
  const char *name, *key;
};
constexpr NamedView kViews[] = {{"Front", "1"},          {"Right", "2"},          {"Left", "3"},
                                {"Upper occlusal", "4"}, {"Lower occlusal", "5"}, {"Condyle", "6"},
                                {"Oblique", "7"}};

constexpr const char* kShortcuts =
    "<b>Mouse and keys</b><br><table cellspacing=6>"
    "<tr><td><b>Ctrl+1 … Ctrl+6</b></td><td>steps of the work</td></tr>"
    "<tr><td><b>1 2 3</b></td><td>views: front, right, left</td></tr>"
    "<tr><td><b>4 5 6 7</b></td><td>upper and lower occlusal, condyle, oblique</td></tr>"
    "<tr><td><b>Left drag</b></td><td>turn</td></tr>"
    "<tr><td><b>Middle drag, Shift + left</b></td><td>move</td></tr>"
    "<tr><td><b>Right drag, wheel</b></td><td>zoom</td></tr>"
    "<tr><td><b>Ctrl+Z, Ctrl+Shift+Z</b></td><td>undo, redo</td></tr>"
    "<tr><td><b>C</b></td><td>cross-section plane</td></tr>"
    "<tr><td><b>D, A, W</b></td><td>measure distance, angle, wall</td></tr>"
    "<tr><td><b>Esc</b></td><td>put the tool down</td></tr>"
    "<tr><td><b>Space</b></td><td>play the motion</td></tr>"
    "<tr><td><b>Shift + drag, wheel</b></td><td>on the timeline: choose an interval, zoom</td></tr>"
    "<tr><td><b>R, L, M, T, K</b></td><td>in Capture: record, live pictures, mark MI, TP, other</td></tr>"
    "<tr><td><b>Enter, Delete</b></td><td>margin: next curve, take the chosen point away</td></tr>"
    "<tr><td><b>Ctrl+S</b></td><td>screenshot into CASE/screenshots</td></tr>"
    "<tr><td><b>F1, ?</b></td><td>this list</td></tr></table>";

}  // namespace

void MainWindow::make_toolbar() {
  QToolBar* bar = addToolBar("Tools");
  bar->setObjectName("toolBar");
  bar->setMovable(false);
  QAction* undo = document_.undo_stack().createUndoAction(this, "↶ Undo");
  undo->setObjectName("undo");
  undo->setShortcut(QKeySequence::Undo);
  QAction* redo = document_.undo_stack().createRedoAction(this, "↷ Redo");
  redo->setObjectName("redo");
  redo->setShortcuts({QKeySequence("Ctrl+Shift+Z"), QKeySequence("Ctrl+Y")});
  for (QAction* action : {undo, redo}) {
    const QString name = action == undo ? "↶ Undo" : "↷ Redo";
    action->setIconText(name);
    // What would be undone stands in the tool tip: the button keeps its width.
    connect(action, &QAction::changed, this, [action, name] {
      if (action->iconText() != name) action->setIconText(name);
    });
    bar->addAction(action);
  }
  bar->addSeparator();
  for (const NamedView& view : kViews) {
    QAction* action = bar->addAction(view.name);
    action->setObjectName(QString("view_") + QString(view.name).toLower().replace(' ', '_'));
    action->setShortcut(QKeySequence(view.key));
    action->setToolTip(QString("%1 view (%2)").arg(view.name, view.key));
    connect(action, &QAction::triggered, this, [this, name = QString(view.name).toLower()] { look(name); });
  }
  bar->addSeparator();
  QAction* plane = bar->addAction("Section");
  plane->setObjectName("sectionAction");
  plane->setCheckable(true);
  plane->setShortcut(QKeySequence("C"));
  plane->setToolTip("The plane of the cross-section, to be dragged (C)");
  connect(plane, &QAction::toggled, this, [this](bool on) {
    plane_on_ = on;
    scene_->show_plane(on);
    if (on) return cut();
    section_->set_curves({});
    section_fitted_ = false;
  });
  make_measuring(bar);
  bar->addSeparator();
  QAction* shot = bar->addAction("Screenshot");
  shot->setObjectName("screenshot");
  shot->setShortcut(QKeySequence::Save);
  shot->setToolTip("Saves the window's picture into the case (Ctrl+S)");
  connect(shot, &QAction::triggered, this, [this] { save_screenshot(); });
  QAction* help = bar->addAction("?");
  help->setObjectName("help");
  help->setShortcuts({QKeySequence("F1"), QKeySequence("?")});
  help->setToolTip("Mouse and keys (F1)");
  connect(help, &QAction::triggered, this, [this] { show_shortcuts(); });
  for (int i = 0; i < kStepCount; ++i)
    connect(new QShortcut(QKeySequence(QString("Ctrl+%1").arg(i + 1)), this), &QShortcut::activated, this,
            [this, i] { steps_->setCurrentIndex(i); });
}

void MainWindow::make_measuring(QToolBar* bar) {
  measure_ = std::make_unique<MeasureTool>(*scene_);
  measure_->measured = [this](const QString& text) { statusBar()->showMessage("Measured: " + text); };
  measuring_ = new QActionGroup(this);
  measuring_->setExclusionPolicy(QActionGroup::ExclusionPolicy::ExclusiveOptional);
  const std::tuple<const char*, const char*, Measure, const char*> kinds[] = {
      {"Distance", "D", Measure::kDistance, "two clicks, in 3D or in the section"},
      {"Angle", "A", Measure::kAngle, "three clicks, the second at the corner"},
      {"Thickness", "W", Measure::kThickness, "one click on the splint, in 3D or in the section"}};
  for (const auto& [name, key, kind, tip] : kinds) {
    QAction* action = bar->addAction(name);
    action->setObjectName(QString("measure") + name);
    action->setCheckable(true);
    action->setShortcut(QKeySequence(key));
    action->setToolTip(QString("%1: %2 (%3)").arg(name, tip, key));
    measuring_->addAction(action);
    connect(action, &QAction::toggled, this, [this, k = kind](bool on) {
      if (on) {
        bench_->tool_taken(this);
        measure_->begin(k);
        section_->set_measuring(k);
      } else if (!measuring_->checkedAction()) {
        measure_->end();
        section_->set_measuring({});
      }
    });
  }
  const auto put_down = [this] {
    if (QAction* on = measuring_->checkedAction()) on->setChecked(false);
  };
  bench_->tool_taken.add([this, put_down](const void* who) {
    if (who != this) put_down();
  });
  connect(new QShortcut(QKeySequence("Esc"), this), &QShortcut::activated, this, [this, put_down] {
    put_down();
    bench_->tool_taken(nullptr);
    if (shortcuts_) shortcuts_->hide();
    for (auto* chart : findChildren<QWidget*>("largeChart")) chart->hide();
  });
}

void MainWindow::make_status() {
  coordinates_ = new QLabel;
  coordinates_->setObjectName("coordinates");
  job_text_ = new QLabel;
  job_text_->setObjectName("jobText");
  job_bar_ = new QProgressBar;
  job_bar_->setObjectName("jobBar");
  job_bar_->setRange(0, 1000);
  job_bar_->setTextVisible(false);
  job_bar_->setFixedSize(140, 12);
  job_cancel_ = new QToolButton;
  job_cancel_->setObjectName("jobCancel");
  job_cancel_->setText("Cancel");
  connect(job_cancel_, &QToolButton::clicked, this, [this] { jobs_.cancel_all(); });
  statusBar()->addPermanentWidget(coordinates_);
  statusBar()->addPermanentWidget(job_text_);
  statusBar()->addPermanentWidget(job_bar_);
  statusBar()->addPermanentWidget(job_cancel_);
  statusBar()->showMessage(
      "Left drag: turn. Middle or Shift drag: move. Right drag or wheel: zoom. F1: all keys.");
  job_timer_.setInterval(100);
  connect(&job_timer_, &QTimer::timeout, this, [this] { show_job(); });
  show_job();
}

void MainWindow::show_job() {
  const bool busy = jobs_.busy();
  for (QWidget* w : std::initializer_list<QWidget*>{job_text_, job_bar_, job_cancel_}) w->setVisible(busy);
  scene_->allow_full_detail(!busy);
  second_->allow_full_detail(!busy);
  if (!busy) return job_timer_.stop();
  const JobState s = jobs_.state();
  job_text_->setText(s.step.isEmpty() ? s.name : s.name + ": " + s.step);
  job_bar_->setValue(static_cast<int>(1000 * s.fraction));
  if (!job_timer_.isActive()) job_timer_.start();
}

void MainWindow::look(const QString& name) {
  const ArchFrame arch =
      document_.is_open() && document_.content().arch ? *document_.content().arch : ArchFrame{};
  if (name == "condyle") {
    for (const char* id : {"condyle_left", "condyle_right"})
      if (const Layer* l = document_.layers().find(id); l && l->visible) {
        scene_->look_from(arch.left * (id == std::string("condyle_left") ? 1 : -1), arch.up);
        return scene_->look_at(l->pose * bounding_box(*l->mesh).centre_mm(), 45);
      }
    // No bone in this case: where the condyle is estimated to be, left of the arch.
    scene_->look_from(arch.left, arch.up);
    return scene_->look_at(arch.incisal_mm - 88 * arch.anterior + 35 * arch.up + 52 * arch.left, 60);
  }
  const std::map<QString, std::pair<Vector3, Vector3>> views = {
      {"front", {arch.anterior, arch.up}},
      {"right", {-arch.left, arch.up}},
      {"left", {arch.left, arch.up}},
      {"upper occlusal", {-arch.up, arch.anterior}},
      {"lower occlusal", {arch.up, arch.anterior}},
      {"oblique", {arch.anterior + 0.75 * arch.left + 0.28 * arch.up, arch.up}}};
  const auto& [towards, up] = views.at(name);
  scene_->look_from(towards, up);
}

/// In full detail: where the processor draws it, it comes a moment after the last change.
void MainWindow::save_screenshot() {
  if (!document_.is_open()) return document_.report("Open a case first: screenshots go into its folder.");
  constexpr int kLookAgainMs = 20;
  if (!scene_->settled() || (second_->widget()->isVisible() && !second_->settled()))
    return QTimer::singleShot(kLookAgainMs, this, [this] { save_screenshot(); });
  const QString folder = QString::fromStdString((document_.content().folder / "screenshots").string());
  QDir().mkpath(folder);
  QString path;
  for (int i = 1;; ++i)
    if (path = QString("%1/screenshot_%2.png").arg(folder).arg(i, 3, 10, QChar('0')); !QFile::exists(path))
      break;
  if (grab().save(path))
    document_.notice("Saved " + path);
  else
    document_.report("The screenshot could not be written to " + path);
}

/// A sheet over the window, not a dialog: Esc, F1 or a click puts it away.
void MainWindow::show_shortcuts() {
  if (!shortcuts_) {
    auto* sheet = new QLabel(kShortcuts, this);
    sheet->setObjectName("shortcutSheet");
    sheet->setTextFormat(Qt::RichText);
    sheet->setMargin(18);
    sheet->adjustSize();
    shortcuts_ = sheet;
    shortcuts_->hide();
  }
  shortcuts_->move((width() - shortcuts_->width()) / 2, (height() - shortcuts_->height()) / 2);
  shortcuts_->setVisible(!shortcuts_->isVisible());
  shortcuts_->raise();
}

QString window_style() {
  // The family by name: what else is installed must not move a line or cut a label.
  return R"(
    QWidget { font-family: "DejaVu Sans"; }
    QToolBar { background: #f4f6f9; border-bottom: 1px solid #d5dae2; spacing: 1px; padding: 2px 6px; }
    QToolBar QToolButton { padding: 3px 6px; border-radius: 4px; }
    QToolBar QToolButton:hover { background: #e2e9f2; }
    QToolBar QToolButton:checked { background: #cfe0f3; color: #0d3d6e; }
    QToolBar QToolButton:disabled { color: #7d8592; }
    QTabBar#steps { background: #e9edf3; }
    QTabBar#steps::tab { padding: 7px 18px; background: #e9edf3; border: none; color: #414b5a; }
    QTabBar#steps::tab:selected { background: #ffffff; color: #0d4a86; border-bottom: 3px solid #1c6fb8; }
    QTabBar#steps::tab:hover:!selected { background: #dde4ed; }
    QScrollArea, QScrollArea > QWidget > QWidget { background: #ffffff; }
    QStackedWidget { background: #ffffff; }
    QLabel[role="heading"] { font-weight: 700; color: #2a3442; padding-top: 4px; }
    QLabel[role="faint"] { color: #58606d; font-size: 8.5pt; }
    QFrame[role="status"] { background: #f2f6fa; border-radius: 5px; }
    QPushButton { padding: 4px 10px; border: 1px solid #b9c2ce; border-radius: 4px; background: #f7f9fb; }
    QPushButton:hover { background: #e8eef5; }
    QPushButton:disabled { color: #8b93a0; background: #f4f5f7; }
    QPushButton[role="primary"] { background: #1c6fb8; color: white; border-color: #1c6fb8; font-weight: 600; }
    QPushButton[role="primary"]:disabled { background: #a9bdd2; border-color: #a9bdd2; color: #f4f7fa; }
    QPushButton[role="record"] { font-size: 14pt; font-weight: 700; color: #a3160c; }
    QPushButton[role="record"]:disabled { color: #9aa1ac; }
    QTableWidget { border: 1px solid #d5dae2; background: white; alternate-background-color: #f6f8fb;
      selection-background-color: #cfe0f3; selection-color: #1c2430; }
    QHeaderView::section { background: #eef1f5; border: none; padding: 3px 4px; color: #414b5a; }
    QLabel#shortcutSheet { background: white; border: 1px solid #9aa6b5; border-radius: 8px; }
    QLabel#emptyScene { color: #414b5a; font-size: 12pt; }
    QSplitter::handle { background: #d5dae2; }
    QWidget#sectionBox, QWidget#jobsList { background: #ffffff; }
    QWidget#jobsList { border-top: 1px solid #d5dae2; }
    QScrollBar:vertical { background: transparent; width: 10px; margin: 0; }
    QScrollBar::handle:vertical { background: #b9c2ce; border-radius: 4px; min-height: 28px; margin: 1px; }
    QScrollBar::handle:vertical:hover { background: #8f9bab; }
    QScrollBar::add-line:vertical, QScrollBar::sub-line:vertical { height: 0; }
    QScrollBar:horizontal { background: transparent; height: 10px; margin: 0; }
    QScrollBar::handle:horizontal { background: #b9c2ce; border-radius: 4px; min-width: 28px; margin: 1px; }
    QScrollBar::add-line:horizontal, QScrollBar::sub-line:horizontal { width: 0; }
    QStatusBar { background: #f4f6f9; border-top: 1px solid #d5dae2; }
    QStatusBar::item { border: none; })";
}

}  // namespace gnathion
