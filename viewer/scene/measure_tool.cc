#include "viewer/scene/measure_tool.h"

#include <cmath>

namespace gnathion {
namespace {

constexpr Color kInk = {0.60, 0.22, 0.0};
constexpr double kClickPx = 4.0;

}  // namespace

void MeasureTool::begin(Measure what) {
  kind_ = what;
  points_mm_.clear();
  text_.clear();
  show();
  scene_.set_tool([this](const SceneMouse& m) { return mouse(m); });
}

void MeasureTool::end() {
  points_mm_.clear();
  scene_.set_tool({});
  scene_.clear_overlay("measure");
}

/// A click sets a point; a drag stays the camera's.
bool MeasureTool::mouse(const SceneMouse& m) {
  if (m.kind == SceneMouse::Kind::kPress) pressed_px_ = m.px;
  if (m.kind != SceneMouse::Kind::kRelease || !m.at) return false;
  const QPointF moved = m.px - pressed_px_;
  if (std::hypot(moved.x(), moved.y()) <= kClickPx) take(*m.at);
  return false;
}

void MeasureTool::take(const PickedPoint& p) {
  if (points_mm_.size() >= clicks_of(kind_)) points_mm_.clear();
  points_mm_.push_back(p.at_mm);
  text_.clear();
  if (kind_ == Measure::kThickness) {
    const auto surface = scene_.surface(p.layer);
    const Rigid3 mesh_from_dental = p.dental_from_mesh.inverse();
    const auto hit = surface ? surface->ray(mesh_from_dental * (p.at_mm - 0.02 * p.normal),
                                            mesh_from_dental.rotation * -p.normal, 0.0, kThickestMm)
                             : std::nullopt;
    if (!hit) {
      text_ = "no wall behind this point";
    } else {
      points_mm_.push_back(p.dental_from_mesh * hit->point_mm);
      text_ = QString("%1 mm thick").arg((points_mm_[1] - points_mm_[0]).norm(), 0, 'f', 2);
    }
  } else if (kind_ == Measure::kDistance && points_mm_.size() == 2) {
    text_ = QString("%1 mm").arg((points_mm_[1] - points_mm_[0]).norm(), 0, 'f', 2);
  } else if (kind_ == Measure::kAngle && points_mm_.size() == 3) {
    const Vector3 a = points_mm_[0] - points_mm_[1], b = points_mm_[2] - points_mm_[1];
    text_ = QString("%1°").arg(std::atan2(a.cross(b).norm(), a.dot(b)) * 57.29577951308232, 0, 'f', 1);
  }
  if (!text_.isEmpty() && measured) measured(text_);
  show();
}

void MeasureTool::show() {
  Overlay o;
  for (const Vector3& p : points_mm_) o.balls.push_back({p, kInk, 0.35});
  if (points_mm_.size() > 1) o.lines.push_back({points_mm_, kInk, 2.5});
  if (!text_.isEmpty()) {
    const Vector3 middle = points_mm_.size() == 2 ? Vector3(0.5 * (points_mm_[0] + points_mm_[1]))
                                                  : points_mm_[points_mm_.size() / 2];
    o.labels.push_back({middle, text_.toUtf8().toStdString(), kInk, 16, true});
  }
  scene_.set_overlay("measure", std::move(o));
}

}  // namespace gnathion
