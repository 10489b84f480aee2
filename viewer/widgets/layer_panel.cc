#include "viewer/widgets/layer_panel.h"

#include <QHBoxLayout>
#include <QSlider>
#include <QTimer>
#include <QToolButton>
#include <QVBoxLayout>

#include "viewer/widgets/parts.h"

namespace gnathion {

LayerPanel::LayerPanel(LayerModel& layers) : layers_(layers), column_(new QVBoxLayout(this)) {
  setObjectName("layerPanel");
  column_->setContentsMargins(8, 6, 8, 6);
  column_->setSpacing(1);
  layers_.changed.add([this](const std::string& id, LayerChange change) {
    if (change == LayerChange::kAdded || change == LayerChange::kRemoved) {
      if (scheduled_) return;
      scheduled_ = true;
      QTimer::singleShot(0, this, [this] { rebuild(); });
    } else if (change == LayerChange::kLook) {
      const Layer* layer = layers_.find(id);
      auto* eye = findChild<QToolButton*>(QString::fromStdString("eye_" + id));
      if (layer && eye) eye->setChecked(layer->visible);
    }
  });
  rebuild();
}

void LayerPanel::set_groups(const QStringList& order) {
  order_ = order;
  rebuild();
}

QWidget* LayerPanel::make_row(const Layer& layer) {
  auto* row = new QWidget;
  auto* line = new QHBoxLayout(row);
  line->setContentsMargins(0, 0, 0, 0);
  line->setSpacing(6);
  const QString id = QString::fromStdString(layer.id);
  auto* eye = new QToolButton;
  eye->setObjectName("eye_" + id);
  eye->setCheckable(true);
  eye->setAutoRaise(true);
  eye->setIconSize(QSize(18, 18));
  eye->setToolTip("Show or hide " + QString::fromStdString(layer.name));
  const auto draw_eye = [eye](bool on) { eye->setIcon(eye_icon(on)); };
  eye->setChecked(layer.visible);
  draw_eye(layer.visible);
  connect(eye, &QToolButton::toggled, this, [this, draw_eye, key = layer.id](bool on) {
    draw_eye(on);
    layers_.set_visible(key, on);
  });
  auto* swatch = new QLabel;
  swatch->setFixedSize(12, 12);
  swatch->setStyleSheet(
      QString("background:%1;border:1px solid #8a909c;border-radius:2px").arg(qcolor(layer.color_3d).name()));
  swatch->setToolTip("Colour in 3D; the section uses the method's colours");
  auto* name = new QLabel(QString::fromStdString(layer.name));
  auto* opacity = new QSlider(Qt::Horizontal);
  opacity->setObjectName("opacity_" + id);
  opacity->setRange(5, 100);
  opacity->setValue(static_cast<int>(100 * layer.opacity));
  opacity->setFixedWidth(58);
  opacity->setToolTip("Opacity");
  connect(opacity, &QSlider::valueChanged, this,
          [this, key = layer.id](int percent) { layers_.set_opacity(key, percent / 100.0); });
  line->addWidget(eye);
  line->addWidget(swatch);
  line->addWidget(name, 1);
  line->addWidget(opacity);
  return row;
}

void LayerPanel::rebuild() {
  scheduled_ = false;
  while (QLayoutItem* item = column_->takeAt(0)) {
    delete item->widget();
    delete item;
  }
  QStringList groups = order_;
  for (const Layer& l : layers_.layers())
    if (!groups.contains(QString::fromStdString(l.group))) groups << QString::fromStdString(l.group);
  for (const QString& group : groups) {
    bool first = true;
    for (const Layer& l : layers_.layers()) {
      if (QString::fromStdString(l.group) != group) continue;
      if (first) column_->addWidget(heading(group));
      first = false;
      column_->addWidget(make_row(l));
    }
  }
  if (layers_.layers().empty()) column_->addWidget(wrapped("Nothing to show in this case yet.", true));
  column_->addStretch();
}

}  // namespace gnathion
