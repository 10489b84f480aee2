#include "viewer/widgets/camera_view.h"

#include <QPainter>
#include <cmath>

namespace gnathion {
namespace {

/// Sharp, large tags locate well; small or slanted ones do not: sides in pixels of the camera.
double shortest_side_px(const std::vector<float>& c) {
  double least = 1e9;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t a = 2 * k, b = 2 * ((k + 1) % 4);
    least = std::min(least, double(std::hypot(c[b] - c[a], c[b + 1] - c[a + 1])));
  }
  return least;
}

}  // namespace

CameraView::CameraView(QWidget* parent) : QWidget(parent) {
  setMinimumSize(200, 130);
  setToolTip("Green: sides of 40 px and more. Orange and dashed: smaller, corners are less sure.");
}

void CameraView::show_preview(const client::Preview& preview) {
  preview_ = preview;
  const Image8& im = preview.image;
  picture_ =
      QImage(im.pixels.data(), im.width_px, im.height_px, im.width_px, QImage::Format_Grayscale8).copy();
  update();
}

void CameraView::set_facts(const QString& line) {
  facts_ = line;
  update();
}

void CameraView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), QColor(34, 38, 45));
  painter.setPen(QColor(225, 229, 235));
  if (picture_.isNull()) {
    painter.drawText(rect(), Qt::AlignCenter, "no picture yet");
    return;
  }
  const double fit =
      std::min(width() / double(picture_.width()), (height() - 18) / double(picture_.height()));
  const QRectF box((width() - fit * picture_.width()) / 2, 0, fit * picture_.width(),
                   fit * picture_.height());
  painter.setRenderHint(QPainter::SmoothPixmapTransform);
  painter.drawImage(box, picture_);
  painter.setRenderHint(QPainter::Antialiasing);
  const double sx = box.width() / std::max(1, preview_.full_width_px);
  const double sy = box.height() / std::max(1, preview_.full_height_px);
  painter.setFont(QFont(font().family(), 8, QFont::DemiBold));
  for (const client::TagOutline& tag : preview_.tags) {
    if (tag.corners_px.size() != 8) continue;
    const bool good = shortest_side_px(tag.corners_px) >= 40;
    painter.setPen(
        QPen(good ? QColor(40, 210, 140) : QColor(255, 170, 40), 2, good ? Qt::SolidLine : Qt::DashLine));
    QPolygonF outline;
    for (std::size_t k = 0; k < 4; ++k)
      outline << box.topLeft() + QPointF(sx * tag.corners_px[2 * k], sy * tag.corners_px[2 * k + 1]);
    painter.drawPolygon(outline);
    painter.drawText(outline.boundingRect(), Qt::AlignCenter, QString::number(tag.id));
  }
  painter.setPen(QColor(225, 229, 235));
  painter.setFont(QFont(font().family(), 8));
  painter.drawText(QRect(6, height() - 17, width() - 12, 16), Qt::AlignLeft | Qt::AlignVCenter,
                   QString::fromStdString(preview_.stream) + "   " + facts_);
}

}  // namespace gnathion
