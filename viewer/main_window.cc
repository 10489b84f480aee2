#include "viewer/main_window.h"

#include <QAction>
#include <QCheckBox>
#include <QDockWidget>
#include <QFileDialog>
#include <QGroupBox>
#include <QHeaderView>
#include <QLabel>
#include <QSlider>
#include <QStatusBar>
#include <QTableWidget>
#include <QToolBar>
#include <QVBoxLayout>

namespace gnathion {

MainWindow::MainWindow(CaseScene scene) : scene_(std::move(scene)) {
  setWindowTitle(QString("Gnathion: %1 (research use)").arg(QString::fromStdString(scene_.title)));
  resize(1280, 800);
  view_ = std::make_unique<CaseView>(this);
  setCentralWidget(view_->widget());
  view_->show(scene_);

  auto* left = new QDockWidget("Case", this);
  left->setFeatures(QDockWidget::DockWidgetMovable);
  auto* panel = new QWidget;
  auto* column = new QVBoxLayout(panel);
  column->addWidget(make_layer_panel());
  column->addWidget(make_gate_panel(), 1);
  if (!scene_.missing.empty()) column->addWidget(make_missing_panel());
  left->setWidget(panel);
  left->setMinimumWidth(340);
  addDockWidget(Qt::LeftDockWidgetArea, left);

  auto* right = new QDockWidget("Cross-section", this);
  right->setFeatures(QDockWidget::DockWidgetMovable);
  profile_ = new ProfilePlot;
  right->setWidget(profile_);
  addDockWidget(Qt::RightDockWidgetArea, right);
  resizeDocks({left, right}, {340, 380}, Qt::Horizontal);

  make_toolbar();
  statusBar()->showMessage("Left drag: turn. Middle drag: move. Wheel: zoom. Drag the blue plane to cut.");
  start_section();
}

MainWindow::~MainWindow() = default;

void MainWindow::start() {
  const ArchFrame arch = scene_.arch.value_or(ArchFrame{});
  view_->look_from(arch.anterior + 0.8 * arch.left - 0.3 * arch.up, arch.up);
  view_->show_plane(true);
}

QWidget* MainWindow::make_layer_panel() {
  auto* group = new QGroupBox("Layers");
  auto* column = new QVBoxLayout(group);
  if (scene_.layers.empty()) column->addWidget(new QLabel("Nothing to show in this case yet."));
  for (std::size_t i = 0; i < scene_.layers.size(); ++i) {
    const Layer& layer = scene_.layers[i];
    auto* row = new QHBoxLayout;
    auto* swatch = new QLabel;
    swatch->setFixedSize(14, 14);
    swatch->setStyleSheet(
        QString("background:%1;border:1px solid #888")
            .arg(QColor::fromRgbF(layer.color_2d[0], layer.color_2d[1], layer.color_2d[2]).name()));
    auto* box = new QCheckBox(QString::fromStdString(layer.name));
    box->setChecked(layer.visible);
    auto* opacity = new QSlider(Qt::Horizontal);
    opacity->setRange(10, 100);
    opacity->setValue(static_cast<int>(100 * layer.opacity));
    opacity->setFixedWidth(80);
    opacity->setToolTip("Opacity");
    connect(box, &QCheckBox::toggled, this, [this, i](bool on) {
      scene_.layers[i].visible = on;
      view_->set_visible(i, on);
      cut(view_->plane());
    });
    connect(opacity, &QSlider::valueChanged, this,
            [this, i](int percent) { view_->set_opacity(i, percent / 100.0); });
    row->addWidget(swatch);
    row->addWidget(box, 1);
    row->addWidget(opacity);
    column->addLayout(row);
    boxes_.push_back(box);
  }
  return group;
}

QWidget* MainWindow::make_gate_panel() {
  auto* group = new QGroupBox(scene_.verdict.empty() ? QString("Gates")
                                                     : "Gates: " + QString::fromStdString(scene_.verdict));
  auto* column = new QVBoxLayout(group);
  if (scene_.gates.empty()) {
    auto* note = new QLabel("No verified design in this case yet.");
    note->setWordWrap(true);
    column->addWidget(note);
    column->addStretch();
    return group;
  }
  auto* table = new QTableWidget(static_cast<int>(scene_.gates.size()), 3);
  table->setHorizontalHeaderLabels({"gate", "value", "limit"});
  table->verticalHeader()->hide();
  table->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table->setShowGrid(false);
  for (int r = 0; r < table->rowCount(); ++r) {
    const GateLine& gate = scene_.gates[static_cast<std::size_t>(r)];
    QString name = QString::fromStdString(gate.name);
    auto* item = new QTableWidgetItem((gate.pass ? QString::fromUtf8("✓ ") : QString::fromUtf8("✗ ")) +
                                      name.replace('_', ' '));
    item->setForeground(gate.pass ? QColor(17, 99, 41) : QColor(164, 14, 38));
    item->setToolTip(name);
    table->setItem(r, 0, item);
    table->setItem(r, 1, new QTableWidgetItem(QString::number(gate.value, 'g', 3)));
    table->setItem(r, 2, new QTableWidgetItem(QString::number(gate.limit, 'g', 3)));
  }
  table->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  table->horizontalHeader()->setSectionResizeMode(1, QHeaderView::ResizeToContents);
  table->horizontalHeader()->setSectionResizeMode(2, QHeaderView::ResizeToContents);
  column->addWidget(table);
  return group;
}

QWidget* MainWindow::make_missing_panel() {
  auto* group = new QGroupBox("Missing");
  auto* column = new QVBoxLayout(group);
  for (const std::string& line : scene_.missing) {
    auto* label = new QLabel(QString::fromStdString(line));
    label->setWordWrap(true);
    label->setStyleSheet("color:#8a4b00");
    column->addWidget(label);
  }
  return group;
}

void MainWindow::make_toolbar() {
  QToolBar* bar = addToolBar("Views");
  bar->setMovable(false);
  const ArchFrame arch = scene_.arch.value_or(ArchFrame{});
  const std::tuple<const char*, const char*, Vector3, Vector3> views[] = {
      {"Front", "1", arch.anterior, arch.up},
      {"Left", "2", arch.left, arch.up},
      {"Right", "3", -arch.left, arch.up},
      {"Occlusal", "4", -arch.up, arch.anterior},
      {"Oblique", "5", arch.anterior + 0.8 * arch.left - 0.3 * arch.up, arch.up}};
  for (const auto& [name, key, towards, up] : views) {
    QAction* action = bar->addAction(name);
    action->setShortcut(QKeySequence(key));
    action->setToolTip(QString("%1 view (key %2)").arg(name, key));
    connect(action, &QAction::triggered, this, [this, t = towards, u = up] { view_->look_from(t, u); });
  }
  bar->addSeparator();
  QAction* plane = bar->addAction("Section");
  plane->setCheckable(true);
  plane->setChecked(true);
  plane->setShortcut(QKeySequence("C"));
  plane->setToolTip("Show the plane of the cross-section (key C)");
  connect(plane, &QAction::toggled, this, [this](bool on) { view_->show_plane(on); });
  QAction* shot = bar->addAction("Screenshot…");
  shot->setShortcut(QKeySequence::Save);
  connect(shot, &QAction::triggered, this, [this] {
    const QString path =
        QFileDialog::getSaveFileName(this, "Save a screenshot", "gnathion.png", "PNG (*.png)");
    if (!path.isEmpty() && !grab().save(path))
      statusBar()->showMessage("The screenshot could not be written to " + path);
  });
}

void MainWindow::start_section() {
  view_->on_plane_moved([this](const SectionPlane& plane) { cut(plane); });
  SectionPlane plane;
  if (scene_.arch) {
    const ArchRuler ruler(*scene_.arch);
    const double s_mm = 0.75 * ruler.s_max_mm();  // among the left molars
    plane = {ruler.at(s_mm), ruler.outward(s_mm), scene_.arch->up};
  } else if (!scene_.layers.empty()) {
    plane.origin_mm = bounding_box(scene_.layers.front().mesh).centre_mm();
  }
  view_->set_plane(plane);
}

void MainWindow::cut(const SectionPlane& plane) {
  std::vector<PlotCurve> curves;
  for (const Layer& layer : scene_.layers)
    if (layer.visible)
      curves.push_back({layer.name, layer.color_2d, layer.width_2d_px, cut_mesh(layer.mesh, plane)});
  profile_->set_curves(std::move(curves));
}

}  // namespace gnathion
