#include "evaluation/distance_field.h"

#include <cmath>

namespace gnathion {
namespace {

constexpr double kClearlyNearerMm = 0.3;
constexpr double kOnItMm = 0.5;

PointUse use_of(const SurfaceFoot& foot, const Vector3& way, const Vector3& facing, double scan_rim_mm,
                const FieldOptions& options) {
  if (foot.on_boundary) {
    const double along = std::abs(way.dot(foot.normal));
    if ((way - way.dot(foot.normal) * foot.normal).norm() > along) return PointUse::kBeyondRim;
    return PointUse::kBoundary;
  }
  if (foot.to_boundary_mm < options.rim_mm || scan_rim_mm < options.rim_mm) return PointUse::kBoundary;
  // A vertex without a normal (triangles without area only) has no direction to disagree in.
  if (facing.squaredNorm() > 0.0 && facing.dot(foot.normal) < std::cos(options.steep_deg * M_PI / 180.0))
    return PointUse::kSteep;
  return PointUse::kCore;
}

/// Two passes, in the order of the points: the same sums on any number of threads.
PointStatistics statistics_of(const DistanceField& field, bool core_only) {
  PointStatistics s;
  const auto counts = [&](std::size_t i) {
    return core_only ? field.use[i] == PointUse::kCore : is_measured(field.use[i]);
  };
  for (std::size_t i = 0; i < field.use.size(); ++i)
    if (counts(i)) s.avg_mm += static_cast<double>(field.distance_mm[i]), ++s.n;
  if (s.n == 0) return s;
  s.avg_mm /= static_cast<double>(s.n);
  double squares = 0.0;
  for (std::size_t i = 0; i < field.use.size(); ++i)
    if (counts(i)) squares += std::pow(static_cast<double>(field.distance_mm[i]) - s.avg_mm, 2);
  s.std_mm = std::sqrt(squares / static_cast<double>(s.n));
  return s;
}

}  // namespace

ScanFacts facts_of(SharedMesh scan, const FieldOptions& options) {
  ScanFacts facts;
  facts.normals = vertex_normals(*scan);
  facts.to_boundary_mm = distances_to_boundary_mm(*scan, 2.0 * options.rim_mm);
  facts.used.assign(scan->vertices_mm.size(), false);
  for (const Triangle& t : scan->triangles)
    for (std::uint32_t v : t) facts.used[v] = true;
  facts.mesh = std::move(scan);
  return facts;
}

DistanceField measure_field(const ScanFacts& scan, const SharedMesh& model, const SurfaceDistance& distance,
                            const Rigid3& dental_from_scan, const std::vector<bool>& foreign,
                            const FieldOptions& options) {
  DistanceField field;
  field.scan = scan.mesh;
  field.reference = model;
  field.dental_from_scan = dental_from_scan;
  const std::vector<Vector3>& points = scan.mesh->vertices_mm;
  field.distance_mm.assign(points.size(), 0.0f);
  field.use.assign(points.size(), PointUse::kFar);
  distance.for_each(points, dental_from_scan, options.reach_mm, [&](std::size_t i, const SurfaceFoot& foot) {
    const Vector3 way = dental_from_scan * points[i] - foot.point_mm;
    field.distance_mm[i] = static_cast<float>(foot.signed_mm);
    field.use[i] = use_of(foot, way, dental_from_scan.rotation * scan.normals[i],
                          static_cast<double>(scan.to_boundary_mm[i]), options);
  });
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!scan.used[i] || (!foreign.empty() && foreign[i])) {
      field.use[i] = PointUse::kForeign;
      field.distance_mm[i] = 0.0f;
    }
    switch (field.use[i]) {
      case PointUse::kCore:
        break;
      case PointUse::kBoundary:
        ++field.boundary;
        break;
      case PointUse::kSteep:
        ++field.steep;
        break;
      case PointUse::kBeyondRim:
        ++field.beyond_rim;
        break;
      case PointUse::kFar:
        ++field.far;
        break;
      case PointUse::kForeign:
        ++field.foreign;
        break;
    }
  }
  field.all = statistics_of(field, false);
  field.core = statistics_of(field, true);
  return field;
}

std::vector<bool> foreign_points(const ScanFacts& scan, const SurfaceDistance& own,
                                 const SurfaceDistance& other, const Rigid3& dental_from_scan,
                                 double reach_mm) {
  const std::vector<Vector3>& points = scan.mesh->vertices_mm;
  std::vector<float> to_own(points.size(), static_cast<float>(reach_mm));
  std::vector<std::uint8_t> foreign(points.size(), 0);  // not bits: threads write side by side
  own.for_each(points, dental_from_scan, reach_mm, [&](std::size_t i, const SurfaceFoot& foot) {
    const bool alike = foot.normal.dot(dental_from_scan.rotation * scan.normals[i]) > 0.0;
    if (alike) to_own[i] = static_cast<float>(std::abs(foot.signed_mm));
  });
  other.for_each(points, dental_from_scan, kOnItMm, [&](std::size_t i, const SurfaceFoot& foot) {
    const bool alike = foot.normal.dot(dental_from_scan.rotation * scan.normals[i]) > 0.5;
    const double d = std::abs(foot.signed_mm);
    foreign[i] = alike && !foot.on_boundary && d + kClearlyNearerMm < static_cast<double>(to_own[i]);
  });
  return {foreign.begin(), foreign.end()};
}

}  // namespace gnathion
