#include "design/bow/bodies.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "design/adaptive_mesh.h"
#include "design/bow/shapes.h"

namespace gnathion {
namespace {

constexpr double kBar_mm = 3.2;      // radius of the carrier's bar
constexpr double kBehind_mm = 10.0;  // of the bar behind the plates
constexpr int kColumns = 5;
constexpr double kGap_mm = 1.4;  // between plates of a row
constexpr double kYaw_deg = 10;
constexpr double kBandThickness_mm = 4.0, kBandHeight_mm = 20.0, kBandHalf_deg = 62.0;
constexpr double kStrapSlot_mm = 3.5, kStrapHeight_mm = 12.0;

double curved_y(double x, double depth_mm) {
  return -depth_mm + 0.0025 * x * x;
}

/// The carrier's bar: a polyline behind the plates, higher on the left, so that no half-turn maps it on
/// itself.
std::array<Vector3, 5> bar_points(const BowParameters& p) {
  const double half = 2 * (plate_side_mm(p) + kGap_mm) + 4;
  const auto at = [&](double x, double z) {
    return Vector3(x, curved_y(x, p.carrier_distance_mm) + kBehind_mm, z);
  };
  return {at(-half, -4.0), at(-0.5 * half, -3.0), at(0, -2.0), at(0.5 * half, 0.5), at(half, 3.0)};
}

template <class Points>
Vector3 nearest_on(const Points& line, const Vector3& p) {
  Vector3 best = line[0];
  for (std::size_t n = 1; n < line.size(); ++n) {
    const Vector3 along = line[n] - line[n - 1];
    const double t = std::clamp((p - line[n - 1]).dot(along) / along.squaredNorm(), 0.0, 1.0);
    const Vector3 q = line[n - 1] + t * along;
    if ((q - p).norm() < (best - p).norm()) best = q;
  }
  return best;
}

template <class Points>
double rope(const Points& line, const Vector3& p, double radius) {
  double d = std::numeric_limits<double>::max();
  for (std::size_t n = 1; n < line.size(); ++n)
    d = std::min(d, shape::capsule(p, line[n - 1], line[n], radius));
  return d;
}

/// Solids on the stem before the lips that the scanner of the mouth reaches and no turn maps on each other:
/// they fix where the bow lies on the teeth, beyond what the clutch's own face does.
double scan_features(const Vector3& p, const Vector3& base) {
  const Vector3 q = p - base;
  if (q.norm() > 30) return q.norm() - 25;
  double d = shape::block(exp_so3(Vector3(0, 0, 0.3)) * q, {12, 4.5, 3.6}, 0.8);
  const auto knob = [&](const Vector3& to, double radius) {
    return shape::join(shape::capsule(q, {0.5 * to.x(), 0, 0}, to, 1.9), shape::ball(q, to, radius), 0.8);
  };
  d = shape::join(d, knob({-17, 4, 7}, 3.8), 1.0);
  d = shape::join(d, knob({16, 6, -8}, 3.0), 1.0);
  d = shape::join(d, knob({5, 1, 11}, 2.5), 1.0);
  return shape::join(
      d, shape::block(exp_so3(Vector3(0.4, 0.5, 0.2)) * (q - Vector3(-6, -1, -6)), {4, 3, 3.5}, 0.6), 1.0);
}

/// Where the ends of a strapped band and its plates lie: an arc about (0, R, 0).
Vector3 on_arc(double radius, double angle_rad, double z) {
  return {radius * std::sin(angle_rad), radius - radius * std::cos(angle_rad), z};
}

Vector3 as_float(const Vector3& v) {
  return v.cast<float>().cast<double>();
}

}  // namespace

std::vector<TagPlate> bow_plates(const BowParameters& p) {
  constexpr std::array<double, kColumns> kPitchLow = {-4, 16, -2, 18, 0}, kPitchHigh = {18, -3, 15, -1, 17};
  const double pitch = plate_side_mm(p) + kGap_mm, half = 0.5 * plate_side_mm(p) + 1.5;
  const auto bar = bar_points(p);
  std::vector<TagPlate> plates;
  for (int row = 0; row < 2; ++row)
    for (int c = 0; c < kColumns; ++c) {
      const double x = (c - 2) * pitch + row, yaw = ((c + row) % 2 == 0 ? kYaw_deg : -kYaw_deg);
      const double y = curved_y(x, p.carrier_distance_mm) - (row == 0 ? 4 : 0);
      const auto at = static_cast<std::size_t>(c);
      TagPlate plate = tag_plate_at(row * kColumns + c, {x, y, row == 0 ? -half - 0.5 : half + 0.5}, yaw,
                                    row == 0 ? kPitchLow[at] : kPitchHigh[at]);
      plate.root_mm = nearest_on(bar, plate.body_from_plate * Vector3(0, 0, -kPlateThickness_mm));
      plates.push_back(plate);
    }
  return plates;
}

BodyField bow_field(const Clutch& clutch, const PlateSolids& plates, const BowParameters& p) {
  const auto bar = bar_points(p);
  // As high as the clutch at its root: what reached below would end in a wedge over the gingiva.
  const double top = clutch.stem_top_mm(),
               height = std::clamp(top - clutch.stem_bottom_mm(), 2.0, p.stem_height_mm);
  const double stem_z = top - 0.5 * height,
               back = clutch.front_y_mm() - p.bonding_gap_mm - 0.4 * p.clutch_thickness_mm,
               front = bar[2].y() + 2;
  const Vector3 half(0.5 * p.stem_width_mm, 0.5 * (back - front), 0.5 * height);
  const Vector3 middle(0, 0.5 * (back + front), stem_z);
  const Vector3 features(0, front + 3, stem_z);
  const auto body = [=, &clutch, &plates](const Vector3& q) {
    double d = shape::join(shape::block(q - middle, half, 1.2), clutch.shell_mm(q), 1.5);
    d = shape::join(d, scan_features(q, features), 1.5);
    d = shape::join(d, shape::capsule(q, {0, front + 1, stem_z}, bar[2], 4.0), 2.0);
    d = shape::join(d, rope(bar, q, kBar_mm), 2.0);
    return plates.joined(d, q);
  };
  BodyField out;
  out.field.estimate = [=, &clutch](const Vector3& q) {
    return std::max(body(q), clutch.room_estimate_mm(q));
  };
  out.field.exact = [=, &clutch](const std::vector<Vector3>& points, std::vector<double>& values) {
    clutch.room_exact_mm(points, values);
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = std::max(values[i], body(points[i]));
  };
  out.field.sure_mm = 0.15;
  const double wide = bar[4].x() + 16, tall = plate_side_mm(p) + 10;
  out.box.extend({-wide, -p.carrier_distance_mm - 16, -tall});
  out.box.extend({wide, 14, tall});
  return out;
}

std::vector<TagPlate> head_plates(const BowParameters& p) {
  constexpr std::array<double, 4> kPitchLow = {-20, -2, -18, 0}, kPitchHigh = {-2, -21, 1, -17};
  const double pitch = plate_side_mm(p) + 3.0, r = p.forehead_radius_mm;
  std::vector<TagPlate> plates;
  for (int row = 0; row < 2; ++row)
    for (int c = 0; c < 4; ++c) {
      const double angle = (c - 1.5) * pitch / (r + 14) + 0.01 * row;
      const Vector3 out = -Vector3(-std::sin(angle), std::cos(angle), 0);
      const double z = row == 0 ? 4.0 : 4.0 + plate_side_mm(p) + 4.0;
      const double yaw = 0.3 * angle * 180 / std::numbers::pi + ((c + row) % 2 == 0 ? -8 : 8);
      const auto at = static_cast<std::size_t>(c);
      TagPlate plate = tag_plate_at(20 + 4 * row + c, on_arc(r, angle, z) + (row == 0 ? 14 : 11) * out, yaw,
                                    row == 0 ? kPitchLow[at] : kPitchHigh[at]);
      plate.root_mm =
          on_arc(r, angle, row == 0 ? 2.0 : 0.5 * kBandHeight_mm - 3.5) + 0.5 * kBandThickness_mm * out;
      plates.push_back(plate);
    }
  return plates;
}

BodyField head_field(const PlateSolids& plates, const BowParameters& p) {
  const double r = p.forehead_radius_mm, limit = kBandHalf_deg * std::numbers::pi / 180;
  const auto body = [=, &plates](const Vector3& q) {
    // In the band's own coordinates: along the arc, across (0 at the skin, outwards positive), up.
    const double angle = std::atan2(q.x(), r - q.y());
    const Vector3 flat(r * angle, std::hypot(q.x(), r - q.y()) - r - 0.5 * kBandThickness_mm, q.z());
    double d = shape::block(flat, {r * limit, 0.5 * kBandThickness_mm, 0.5 * kBandHeight_mm}, 1.2);
    for (const double side : {-1.0, 1.0}) {
      const Vector3 slot = flat - Vector3(side * (r * limit - 7), 0, 0);
      d = std::max(d, -shape::block(slot, {0.5 * kStrapSlot_mm, 10, 0.5 * kStrapHeight_mm}, 1.0));
    }
    return plates.joined(d, q);
  };
  BodyField out;
  out.field.estimate = body;
  out.field.exact = pointwise(body);
  const double wide = r * std::sin(limit) + 14;
  out.box.extend({-wide, -30, -plate_side_mm(p)});
  out.box.extend({wide, r * (1 - std::cos(limit)) + 14, 2 * plate_side_mm(p) + 10});
  return out;
}

TriangleMesh body_surface(const BodyField& body, double fine_mm,
                          const std::function<double(const Vector3&)>& tolerance_mm,
                          std::vector<std::string>& warnings) {
  constexpr int kRefinement = 4;
  GridShape shape;
  shape.spacing_mm = fine_mm * kRefinement;
  shape.origin_mm = body.box.min_mm;
  shape.nodes = (body.box.size_mm() / shape.spacing_mm).cast<int>() + Eigen::Vector3i::Constant(2);
  LargestPiece piece = largest_piece(extracted_surface(body.field, shape, kRefinement));
  if (piece.largest_island_mm3 > 1.0)
    warnings.push_back(fmt::format("a piece of {:.1f} mm3 was cut off by the clearances and is left out",
                                   piece.largest_island_mm3));
  AdaptiveMeshOptions options;
  options.tolerance_mm = tolerance_mm;
  options.longest_edge_mm = 6.0;
  TriangleMesh mesh = adaptive_mesh(piece.mesh, options);
  for (Vector3& v : mesh.vertices_mm) v = as_float(v);
  return mesh;
}

}  // namespace gnathion
