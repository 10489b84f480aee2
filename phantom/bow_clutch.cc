#include "phantom/bow_clutch.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "phantom/bodies_field.h"

namespace gnathion {
namespace {

constexpr std::array<int, 8> kClutchTeeth = {44, 43, 42, 41, 31, 32, 33, 34};
constexpr std::array<int, 8> kUpperTeeth = {14, 13, 12, 11, 21, 22, 23, 24};

std::vector<Vector3> crown(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi, int tooth) {
  std::vector<Vector3> points;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v] == tooth) points.push_back(mesh.vertices_mm[v]);
  GNATHION_CHECK(!points.empty());
  return points;
}

Vector3 middle(const std::vector<Vector3>& points) {
  Box box;
  for (const Vector3& p : points) box.extend(p);
  return box.centre_mm();
}

/// The lowest edge of the upper teeth that overlap the lower ones, less a margin.
Profile top_profile(const PhantomJaws& jaws, double margin_mm) {
  std::vector<std::array<double, 2>> points;
  for (const int tooth : kUpperTeeth) {
    const auto vertices = crown(jaws.maxilla, jaws.maxilla_fdi, tooth);
    double low = std::numeric_limits<double>::max();
    for (const Vector3& v : vertices) low = std::min(low, v.z());
    points.push_back({middle(vertices).x(), low - margin_mm});
  }
  return Profile(points);
}

/// The labial gingival margin of the lower teeth: the lowest crown points on the outer side.
Profile bottom_profile(const PhantomJaws& jaws, double margin_mm) {
  std::vector<std::array<double, 2>> points;
  for (const int tooth : kClutchTeeth) {
    const auto vertices = crown(jaws.mandible_mi, jaws.mandible_fdi, tooth);
    const Vector3 centre = middle(vertices);
    double low = std::numeric_limits<double>::max();
    for (const Vector3& v : vertices) {
      const Vector3 out = v - centre;
      if (out.y() < -0.8 || std::abs(v.x()) > std::abs(centre.x()) + 1.5) low = std::min(low, v.z());
    }
    points.push_back({centre.x(), low + margin_mm});
  }
  return Profile(points);
}

}  // namespace

Profile::Profile(std::vector<std::array<double, 2>> points) : points_(std::move(points)) {
  std::sort(points_.begin(), points_.end());
}

double Profile::operator()(double x) const {
  if (x <= points_.front()[0]) return points_.front()[1];
  for (std::size_t n = 1; n < points_.size(); ++n) {
    if (x > points_[n][0]) continue;
    const double t = (x - points_[n - 1][0]) / (points_[n][0] - points_[n - 1][0]);
    return points_[n - 1][1] + t * (points_[n][1] - points_[n - 1][1]);
  }
  return points_.back()[1];
}

ClutchField::ClutchField(const PhantomJaws& jaws, const ClutchDesign& design)
    : design_(design),
      mandible_(jaws.mandible_mi),
      maxilla_(jaws.maxilla),
      top_(top_profile(jaws, design.below_upper_edge_mm)),
      bottom_(bottom_profile(jaws, 0.3)) {
  Box teeth;
  for (const int tooth : kClutchTeeth) {
    const auto vertices = crown(jaws.mandible_mi, jaws.mandible_fdi, tooth);
    Vector3 m = middle(vertices);
    m.z() = 0;
    arch_.push_back(m);
    for (const Vector3& v : vertices) teeth.extend(v);
  }
  near_.extend(teeth.min_mm - Vector3::Constant(3));
  near_.extend(teeth.max_mm + Vector3::Constant(3));
  const Vector3 from(0, teeth.min_mm.y() - 20, 0.5 * (top_(0) + bottom_(0)));
  const auto hit = mandible_.ray(from, Vector3::UnitY(), 0, 60);
  front_y_mm_ = hit ? hit->point_mm.y() : teeth.min_mm.y();
}

double ClutchField::from_teeth_mm(const Vector3& p) const {
  const auto found = mandible_.signed_distance(p, kFar_mm);
  return found ? found->distance_mm : kFar_mm;
}

double ClutchField::from_maxilla_mm(const Vector3& p) const {
  const auto found = maxilla_.signed_distance(p, kFar_mm);
  return found ? found->distance_mm : kFar_mm;
}

double ClutchField::outside_of_arch_mm(const Vector3& p) const {
  const Vector3 flat(p.x(), p.y(), 0);
  double nearest = std::numeric_limits<double>::max(), side = 0;
  for (std::size_t n = 1; n < arch_.size(); ++n) {
    const Vector3 along = arch_[n] - arch_[n - 1];
    const double t = std::clamp((flat - arch_[n - 1]).dot(along) / along.squaredNorm(), 0.0, 1.0);
    const Vector3 away = flat - arch_[n - 1] - t * along;
    if (away.norm() >= nearest) continue;
    nearest = away.norm();
    // The arch runs from the patient's right to the left, so its outer side (front) is to the right of it.
    side = along.cross(away).z() < 0 ? 1 : -1;
  }
  return side * nearest;
}

double ClutchField::beyond_ends_mm(const Vector3& p) const {
  const Vector3 flat(p.x(), p.y(), 0);
  const std::size_t last = arch_.size() - 1;
  const double right = (flat - arch_[0]).dot((arch_[0] - arch_[1]).normalized());
  const double left = (flat - arch_[last]).dot((arch_[last] - arch_[last - 1]).normalized());
  return std::max(right, left);
}

double ClutchField::shell(const Vector3& p) const {
  const double to_box = (near_.min_mm - p).cwiseMax(p - near_.max_mm).cwiseMax(0.0).norm();
  if (to_box > 1.0) return to_box;
  const double half = 0.5 * design_.thickness_mm;
  const double wall = std::abs(from_teeth_mm(p) - design_.tooth_gap_mm - half) - half;
  double d = field::intersect(wall, p.z() - top_(p.x()), 0.5);
  d = field::intersect(d, bottom_(p.x()) - p.z(), 0.5);
  d = field::intersect(d, beyond_ends_mm(p), 0.5);
  d = std::max(d, 0.4 - outside_of_arch_mm(p));
  return std::max(d, design_.maxilla_gap_mm - from_maxilla_mm(p));
}

double ClutchField::with_room_for_teeth(double solid, const Vector3& p) const {
  if (solid > 1.0 || p.y() < near_.min_mm.y() - 3) return solid;
  const double d = std::max(solid, design_.tooth_gap_mm - from_teeth_mm(p));
  return std::max(d, design_.maxilla_gap_mm - from_maxilla_mm(p));
}

}  // namespace gnathion
