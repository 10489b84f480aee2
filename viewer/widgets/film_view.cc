#include "viewer/widgets/film_view.h"

#include <QPainter>

namespace gnathion {

FilmView::FilmView(QWidget* parent) : QWidget(parent) {
  setMinimumSize(110, 126);
}

void FilmView::set_caption(const QString& caption) {
  caption_ = caption;
  update();
}

void FilmView::set_film(const Image8& film, double field_mm) {
  film_ = QImage(film.pixels.data(), film.width_px, film.height_px, film.width_px, QImage::Format_Grayscale8)
              .copy();
  field_mm_ = field_mm;
  update();
}

void FilmView::clear() {
  film_ = {};
  update();
}

void FilmView::paintEvent(QPaintEvent*) {
  constexpr int kCaption = 16;
  QPainter painter(this);
  painter.fillRect(rect(), QColor(24, 27, 32));
  painter.setFont(QFont(font().family(), 8));
  painter.setPen(QColor(225, 229, 235));
  painter.drawText(QRect(0, 0, width(), kCaption), Qt::AlignCenter, caption_);
  if (film_.isNull()) {
    painter.drawText(rect(), Qt::AlignCenter, "…");
    return;
  }
  const double side = std::min(width(), height() - kCaption);
  const QRectF box(0.5 * (width() - side), kCaption, side, side);
  painter.setRenderHint(QPainter::SmoothPixmapTransform);
  painter.drawImage(box, film_);
  const double ten = 10.0 / field_mm_ * side;
  const QPointF at(box.left() + 6, box.bottom() - 6);
  painter.setPen(QPen(Qt::black, 4));
  painter.drawLine(at, at + QPointF(ten, 0));
  painter.setPen(QPen(Qt::white, 2));
  painter.drawLine(at, at + QPointF(ten, 0));
}

}  // namespace gnathion
