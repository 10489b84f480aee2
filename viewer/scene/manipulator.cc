#include "viewer/scene/manipulator.h"

#include <cmath>

namespace gnathion {
namespace {

constexpr double kTwoPi = 6.283185307179586;
// Left–right, front–back, up–down: apart for every eye, and named by their letters.
constexpr Color kAxisColors[] = {{0.84, 0.37, 0.0}, {0.0, 0.45, 0.7}, {0.0, 0.62, 0.45}};
constexpr const char* kAxisNames[] = {"left", "back", "up"};
constexpr double kReachPx = 9.0;

double distance_to_segment(const QPointF& p, const QPointF& a, const QPointF& b) {
  const QPointF d = b - a, v = p - a;
  const double length2 = QPointF::dotProduct(d, d);
  const double s = length2 > 0 ? std::clamp(QPointF::dotProduct(v, d) / length2, 0.0, 1.0) : 0.0;
  const QPointF off = v - s * d;
  return std::hypot(off.x(), off.y());
}

}  // namespace

std::vector<Vector3> Manipulator::handle_points(int handle) const {
  std::vector<Vector3> out;
  const int k = handle % 3;
  if (handle < 3) {
    const Vector3 axis = handle_.rotation.col(k);
    return {handle_.translation_mm + 0.25 * size_mm_ * axis, handle_.translation_mm + 1.25 * size_mm_ * axis};
  }
  const Vector3 u = handle_.rotation.col((k + 1) % 3), v = handle_.rotation.col((k + 2) % 3);
  for (int i = 0; i <= 48; ++i) {
    const double a = kTwoPi * i / 48;
    out.push_back(handle_.translation_mm + 0.85 * size_mm_ * (std::cos(a) * u + std::sin(a) * v));
  }
  return out;
}

Overlay Manipulator::look() const {
  Overlay o;
  const int strong = held_ >= 0 ? held_ : lit_;
  for (int h = 0; h < 6; ++h) {
    const Color color = h == strong ? Color{0.95, 0.75, 0.1} : kAxisColors[h % 3];
    const std::vector<Vector3> points = handle_points(h);
    if (h < 3) {
      o.arrows.push_back({points[0], points[1], color});
      o.labels.push_back(
          {points[1] + 0.12 * size_mm_ * handle_.rotation.col(h), kAxisNames[h], color, 13, true});
    } else {
      o.lines.push_back({points, color, h == strong ? 4.5 : 2.5});
    }
  }
  o.balls.push_back({handle_.translation_mm, {0.2, 0.2, 0.25}, 0.05 * size_mm_});
  return o;
}

int Manipulator::handle_at(const QPointF& px, const Project& project) const {
  int best = -1;
  double nearest = kReachPx;
  for (int h = 0; h < 6; ++h) {
    const std::vector<Vector3> points = handle_points(h);
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
      const auto a = project(points[i]), b = project(points[i + 1]);
      if (!a || !b) continue;
      const double d = distance_to_segment(px, *a, *b) - (h < 3 ? 1.0 : 0.0);  // arrows win over rings
      if (d < nearest) nearest = d, best = h;
    }
  }
  return best;
}

bool Manipulator::hover(const QPointF& px, const Project& project) {
  const int before = lit_;
  lit_ = handle_at(px, project);
  return before != lit_;
}

/// Where on the axis the ray comes nearest, mm.
double Manipulator::along_axis(const Ray& ray, const Vector3& axis) const {
  const Vector3 w = start_.translation_mm - ray.origin_mm;
  const double b = axis.dot(ray.direction), d = axis.dot(w), e = ray.direction.dot(w);
  const double denominator = 1.0 - b * b;
  return std::abs(denominator) < 1e-6 ? 0.0 : (b * e - d) / denominator;
}

/// Angle about the axis of where the ray meets the ring's plane.
double Manipulator::about_axis(const Ray& ray, const Vector3& axis) const {
  double facing = axis.dot(ray.direction);
  if (std::abs(facing) < 0.05) facing = facing < 0 ? -0.05 : 0.05;  // ring seen from its edge
  const double s = axis.dot(start_.translation_mm - ray.origin_mm) / facing;
  const Vector3 p = ray.origin_mm + s * ray.direction - start_.translation_mm;
  const int k = held_ % 3;
  return std::atan2(p.dot(start_.rotation.col((k + 2) % 3)), p.dot(start_.rotation.col((k + 1) % 3)));
}

bool Manipulator::press(const QPointF& px, const Ray& ray, const Project& project) {
  held_ = handle_at(px, project);
  if (held_ < 0) return false;
  start_ = handle_;
  const Vector3 axis = start_.rotation.col(held_ % 3);
  start_value_ = held_ < 3 ? along_axis(ray, axis) : about_axis(ray, axis);
  return true;
}

Rigid3 Manipulator::drag(const Ray& ray) const {
  const Vector3 axis = start_.rotation.col(held_ % 3);
  if (held_ < 3) return Rigid3::from_translation((along_axis(ray, axis) - start_value_) * axis);
  double turn = about_axis(ray, axis) - start_value_;
  turn = std::remainder(turn, kTwoPi);
  return Rigid3::about_axis(start_.translation_mm, axis, turn);
}

}  // namespace gnathion
