#include <algorithm>

#include "design/settling.h"
#include "design/verification_steps.h"
#include "occlusion/crowns.h"

namespace gnathion {
namespace {

constexpr double kReachMm = 0.35;        // from where surfaces may come to touch
constexpr double kSeatingForceN = 50.0;  // firm biting on a splint; natural forces are larger
constexpr double kSideForceN = 5.0;
constexpr double kCrownMm = 6.0;
constexpr double kKeptSeatedN = 1.0;

/// Mean of the touching places, by area: inside of the support polygon.
Vector3 centre_of_touch(const std::vector<TouchPoint>& points, double near_mm) {
  Vector3 sum = Vector3::Zero();
  double area = 0.0;
  for (const TouchPoint& t : points)
    if (t.gap_mm < near_mm) {
      sum += t.area_mm2 * t.p_mm;
      area += t.area_mm2;
    }
  if (area <= 0.0 && near_mm < kReachMm) return centre_of_touch(points, kReachMm);
  return area > 0.0 ? Vector3(sum / area) : sum;
}

/// Biting surfaces carry it: those that face the force.
Vector3 centre_of_bite(const std::vector<TouchPoint>& points, const Vector3& along) {
  std::vector<TouchPoint> facing;
  for (const TouchPoint& t : points)
    if (t.normal.dot(along) < -0.3) facing.push_back(t);
  return centre_of_touch(facing.empty() ? points : facing, 0.05);
}

Settled pressed(const std::vector<TouchPoint>& points, const Vector3& along) {
  return settled(points, {kSeatingForceN * along, centre_of_bite(points, along)});
}

std::vector<bool> triangles_of(const FinishedSplint& splint, std::initializer_list<SurfacePart> wanted) {
  std::vector<bool> out(splint.mesh().triangles.size());
  for (std::size_t t = 0; t < out.size(); ++t)
    for (const std::uint32_t v : splint.mesh().triangles[t])
      out[t] = out[t] || std::find(wanted.begin(), wanted.end(), splint.parts[v]) != wanted.end();
  return out;
}

/// Triangles of the opposing arch near the splint's box.
std::vector<bool> triangles_within(const TriangleMesh& mesh, const Box& box) {
  std::vector<bool> out(mesh.triangles.size());
  for (std::size_t t = 0; t < out.size(); ++t) {
    const Vector3 c = (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
    out[t] = (c.array() > box.min_mm.array() - 1.0).all() && (c.array() < box.max_mm.array() + 1.0).all();
  }
  return out;
}

/// Half of the way that the seated splint can be pushed to and fro, the larger of both axes across a.
double play_mm(const std::vector<TouchPoint>& points, const Vector3& centre) {
  ElasticFoundation teeth(points, centre);
  double play = 0.0;
  for (const Vector3& axis : {Vector3(Vector3::UnitX()), Vector3(Vector3::UnitY())}) {
    double reach[2];
    for (const int side : {0, 1}) {
      const Vector3 force = (side ? -kSideForceN : kSideForceN) * axis + kKeptSeatedN * Vector3::UnitZ();
      reach[side] = axis.dot(teeth.under(force).motion * centre - centre);
    }
    play = std::max(play, 0.5 * std::abs(reach[0] - reach[1]));
  }
  return play;
}

}  // namespace

void verify_seating(const SplintInputs& inputs, const FinishedSplint& splint, const Preparation& preparation,
                    SplintVerification& out) {
  const Vector3 a = Vector3::UnitZ();
  // The splint on its arch.
  const auto seat =
      touch_points(preparation.support, splint.query, triangles_of(splint, {SurfacePart::kCavity}), kReachMm);
  const Settled on_arch = pressed(seat, a);
  // The opposing arch on the splint.
  const Box box = bounding_box(splint.mesh());
  const auto bite = touch_points(splint.query, preparation.opposing,
                                 triangles_within(preparation.opposing.mesh(), box), kReachMm);
  const Settled on_splint = pressed(bite, a);
  // The natural bite settles likewise, and is what the splint's is compared with. Where scans overlap in MI
  // the splint gives way exactly (S_occ less the opposing arch), so there natural contact counts as exact,
  // too.
  const Rigid3 mi_from_tp = preparation.tp_from_mi.inverse();
  const MeshQuery opposing_mi(transformed(mi_from_tp, preparation.opposing.mesh()));
  auto natural =
      touch_points(preparation.support, opposing_mi, triangles_within(opposing_mi.mesh(), box), kReachMm);
  for (TouchPoint& t : natural) t.gap_mm = std::max(0.0, t.gap_mm);
  const Settled in_mi = pressed(natural, a);
  if (!on_arch.at_rest || !on_splint.at_rest || !in_mi.at_rest) {
    out.seating_note = !on_arch.at_rest     ? "the splint does not come to rest on its arch"
                       : !on_splint.at_rest ? "the opposing arch does not come to rest on the splint"
                                            : "the jaws do not come to rest in MI";
    return;
  }
  const Rigid3& tp = preparation.tp_from_mi;
  const Rigid3 error = on_arch.motion * on_splint.motion * tp * in_mi.motion.inverse() * tp.inverse();

  PredictedSeating seating;
  seating.alpha_deg = error.angle_rad() * 180.0 / M_PI;
  const Vector3 centroid = tp * (preparation.design_from_dental * preparation.arch.origin_mm);
  seating.t_mm = (error * centroid - centroid).norm();
  const auto crowns = crown_region(inputs.opposing_mi(), preparation.arch, inputs.opposing_arch(), kCrownMm);
  const Rigid3 place = tp * preparation.design_from_dental;
  for (std::size_t v = 0; v < crowns.size(); ++v) {
    if (!crowns[v]) continue;
    const Vector3 p = place * inputs.opposing_mi().vertices_mm[v];
    seating.max_tooth_mm = std::max(seating.max_tooth_mm, (error * p - p).norm());
  }
  const Vector3 centre = centre_of_bite(seat, a);
  seating.splint_mm = (on_arch.motion * centre - centre).norm();
  seating.bite_mm = (on_splint.motion * centroid - centroid).norm();
  seating.natural_mm = (in_mi.motion * (mi_from_tp * centroid) - mi_from_tp * centroid).norm();
  seating.play_mm = play_mm(seat, centre);
  out.predicted_seating = seating;
}

}  // namespace gnathion
