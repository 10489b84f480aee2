#include "viewer/scene/scene_overlay_widget.h"

#include <QEvent>
#include <QPainter>

#include "rendering/charts.h"
#include "viewer/model/colour_maps.h"

namespace gnathion {

SceneOverlayWidget::SceneOverlayWidget(QWidget* scene) : QWidget(scene) {
  setAttribute(Qt::WA_TransparentForMouseEvents);
  setAttribute(Qt::WA_NoSystemBackground);
  scene->installEventFilter(this);
  resize(scene->size());
  show();
}

bool SceneOverlayWidget::eventFilter(QObject* watched, QEvent* event) {
  if (event->type() == QEvent::Resize) resize(static_cast<QWidget*>(watched)->size());
  return false;
}

void SceneOverlayWidget::set_scale(std::optional<ColourScale> scale) {
  scale_ = std::move(scale);
  update();
}

void SceneOverlayWidget::set_caption(const QString& text) {
  caption_ = text;
  update();
}

void SceneOverlayWidget::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!caption_.isEmpty()) {
    painter.setFont(QFont(font().family(), 10, QFont::DemiBold));
    const QRect box =
        painter.fontMetrics().boundingRect(QRect(0, 0, width() - 40, 200), Qt::TextWordWrap, caption_);
    const QRect plate = box.translated(14, 12).adjusted(-6, -4, 6, 4);
    painter.setPen(Qt::NoPen);
    painter.setBrush(QColor(255, 255, 255, 205));
    painter.drawRoundedRect(plate, 4, 4);
    painter.setPen(QColor(28, 36, 48));
    painter.drawText(box.translated(14, 12), Qt::TextWordWrap, caption_);
  }
  if (scale_) draw_scale(painter);
}

void SceneOverlayWidget::draw_scale(QPainter& painter) const {
  const int bar_h = std::min({150, height() / 3, height() - 120}), bar_w = 16;
  if (bar_h < 60) return;
  painter.setFont(QFont(font().family(), 9));
  const QFontMetrics metrics = painter.fontMetrics();
  const auto number = [&](double v) {
    return QString::fromStdString(signed_number(v, 2, scale_->diverging && v > 0));
  };
  const int text_w = std::max(
      {metrics.horizontalAdvance(number(scale_->low)), metrics.horizontalAdvance(number(scale_->high)), 36});
  const int title_w = metrics.horizontalAdvance(scale_->title);
  const int plate_w = std::max(bar_w + text_w + 26, title_w + 16);
  const QRect plate(width() - plate_w - 10, height() - bar_h - 54, plate_w, bar_h + 44);
  painter.setPen(Qt::NoPen);
  painter.setBrush(QColor(255, 255, 255, 215));
  painter.drawRoundedRect(plate, 4, 4);
  painter.setPen(QColor(28, 36, 48));
  painter.drawText(QRect(plate.left() + 8, plate.top() + 4, title_w + 2, 18), Qt::AlignVCenter,
                   scale_->title);
  const QRect bar(plate.left() + 10, plate.top() + 28, bar_w, bar_h);
  for (int y = 0; y < bar_h; ++y) {
    const double s = 1.0 - (y + 0.5) / bar_h;
    const Color c = scale_->diverging ? diverging_color(2 * s - 1) : ramp_color(s);
    painter.fillRect(bar.left(), bar.top() + y, bar_w, 1, QColor::fromRgbF(c[0], c[1], c[2]));
  }
  painter.setBrush(Qt::NoBrush);
  painter.setPen(QColor(90, 96, 108));
  painter.drawRect(bar);
  for (int i = 0; i <= 4; ++i) {
    const int y = bar.top() + bar_h - bar_h * i / 4;
    painter.setPen(QColor(90, 96, 108));
    painter.drawLine(bar.right() + 1, y, bar.right() + 5, y);
    painter.setPen(QColor(28, 36, 48));
    painter.drawText(QRect(bar.right() + 8, y - 9, text_w + 4, 18), Qt::AlignVCenter,
                     number(scale_->low + (scale_->high - scale_->low) * i / 4));
  }
}

}  // namespace gnathion
