// Caption and colour scale over the 3D picture, drawn by Qt so that text is sharp on any screen.
#pragma once

#include <QWidget>
#include <optional>

#include "viewer/scene/scene_view.h"

namespace gnathion {

class SceneOverlayWidget : public QWidget {
 public:
  explicit SceneOverlayWidget(QWidget* scene);
  void set_scale(std::optional<ColourScale> scale);
  void set_caption(const QString& text);

 protected:
  void paintEvent(QPaintEvent* event) override;
  bool eventFilter(QObject* watched, QEvent* event) override;

 private:
  void draw_scale(QPainter& painter) const;
  std::optional<ColourScale> scale_;
  QString caption_;
};

}  // namespace gnathion
