// One virtual X-ray with its caption and a scale of 10 mm.
#pragma once

#include <QImage>
#include <QWidget>

#include "core/image.h"

namespace gnathion {

class FilmView : public QWidget {
 public:
  explicit FilmView(QWidget* parent = nullptr);
  void set_caption(const QString& caption);
  void set_film(const Image8& film, double field_mm);
  void clear();
  const QImage& film() const { return film_; }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  QImage film_;
  QString caption_;
  double field_mm_ = 0;
};

}  // namespace gnathion
