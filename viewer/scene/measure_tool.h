// Measuring on the surfaces: two clicks tell a distance, three an angle, one the thickness there.
#pragma once

#include <QString>
#include <vector>

#include "viewer/model/measure.h"
#include "viewer/scene/scene_view.h"

namespace gnathion {

class MeasureTool {
 public:
  explicit MeasureTool(Scene3d& scene) : scene_(scene) {}
  void begin(Measure what);
  void end();
  const QString& text() const { return text_; }  ///< "2.31 mm"
  std::function<void(const QString&)> measured;

 private:
  bool mouse(const SceneMouse& mouse);
  void take(const PickedPoint& p);
  void show();

  Scene3d& scene_;
  Measure kind_ = Measure::kDistance;
  std::vector<Vector3> points_mm_;
  QPointF pressed_px_;
  QString text_;
};

}  // namespace gnathion
