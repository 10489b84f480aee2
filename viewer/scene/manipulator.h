// Three arrows and three rings to move and turn a body with the mouse; internal to the scene.
#pragma once

#include <QPointF>
#include <functional>
#include <optional>

#include "viewer/scene/scene_view.h"

namespace gnathion {

/// Pure geometry: what it looks like, what the mouse is over, and what a drag means.
class Manipulator {
 public:
  using Project = std::function<std::optional<QPointF>(const Vector3&)>;
  struct Ray {
    Vector3 origin_mm, direction;
  };

  void place(const Rigid3& dental_from_handle) { handle_ = dental_from_handle; }
  void set_size(double mm) { size_mm_ = mm; }
  Overlay look() const;
  /// True when a handle is under the mouse; it is lit.
  bool hover(const QPointF& px, const Project& project);
  bool press(const QPointF& px, const Ray& ray, const Project& project);
  /// The motion since the press, in Dental. While a handle is held.
  Rigid3 drag(const Ray& ray) const;
  void release() { held_ = -1; }
  bool held() const { return held_ >= 0; }

 private:
  std::vector<Vector3> handle_points(int handle) const;  ///< 0–2 arrows, 3–5 rings
  int handle_at(const QPointF& px, const Project& project) const;
  double along_axis(const Ray& ray, const Vector3& axis) const;
  double about_axis(const Ray& ray, const Vector3& axis) const;

  Rigid3 handle_;
  double size_mm_ = 16.0;
  int held_ = -1, lit_ = -1;
  Rigid3 start_;
  double start_value_ = 0.0;
};

}  // namespace gnathion
