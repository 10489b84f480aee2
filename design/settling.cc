#include "design/settling.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "design/solid_distance.h"
#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kStepMm = 0.25;    // between points of the moving body's surface
constexpr double kLeverMm = 20.0;   // scales rotations to lengths: an arch's half width
constexpr double kHoldN_mm = 1e-3;  // spring that keeps what nothing determines
constexpr double kAwayMm = 1.5;     // farther than this nothing holds it
constexpr int kSteps = 200;

using Jacobian = Eigen::Matrix<double, 6, 1>;

/// Gap's derivative by (ω·lever, v) about `centre`.
Jacobian by_motion(const TouchPoint& t, const Vector3& centre) {
  Jacobian j;
  j << (t.p_mm - centre).cross(t.normal) / kLeverMm, t.normal;
  return j;
}

struct System {
  std::vector<Jacobian> rows;
  std::vector<double> gaps, weights;  // mm, N/mm; the smallest gaps first
  double longest_row = 0.0;
  Jacobian pull;  // force, generalised

  /// Those that a motion of this size may close: the first so many.
  std::size_t within(const Jacobian& x) const {
    const double closes_mm = longest_row * x.norm() * (1.0 + 1e-9);
    return static_cast<std::size_t>(std::upper_bound(gaps.begin(), gaps.end(), closes_mm) - gaps.begin());
  }
  double energy(const Jacobian& x) const {
    double e = 0.5 * kHoldN_mm * x.squaredNorm() - pull.dot(x);
    for (std::size_t i = 0, n = within(x); i < n; ++i) {
      const double depth = std::min(0.0, gaps[i] + rows[i].dot(x));
      e += 0.5 * weights[i] * depth * depth;
    }
    return e;
  }
  /// Gradient and Hessian at x, over what touches there.
  void derivatives(const Jacobian& x, Jacobian& gradient, Matrix6& hessian) const {
    gradient = kHoldN_mm * x - pull;
    hessian = kHoldN_mm * Matrix6::Identity();
    for (std::size_t i = 0, n = within(x); i < n; ++i) {
      const double depth = gaps[i] + rows[i].dot(x);
      if (depth >= 0.0) continue;
      gradient += weights[i] * depth * rows[i];
      hessian.noalias() += weights[i] * rows[i] * rows[i].transpose();
    }
  }
};

/// Newton with halved steps, from softer foundations to the stiff one: few points touch at first, and with a
/// stiff one alone the steps would jump from set to set.
Jacobian minimum(System& system, const std::vector<double>& stiff) {
  Jacobian x = Jacobian::Zero();
  system.weights.resize(stiff.size());
  for (const double softness : {1e-3, 1e-2, 1e-1, 1.0}) {
    for (std::size_t i = 0; i < stiff.size(); ++i) system.weights[i] = softness * stiff[i];
    double energy = system.energy(x);
    for (int step = 0; step < kSteps; ++step) {
      Jacobian gradient;
      Matrix6 hessian;
      system.derivatives(x, gradient, hessian);
      Jacobian move = -hessian.ldlt().solve(gradient);
      if (move.norm() > 0.5) move *= 0.5 / move.norm();
      double scale = 1.0, next = system.energy(x + move);
      while (next > energy && scale > 1e-6) {
        scale *= 0.5;
        next = system.energy(x + scale * move);
      }
      if (next > energy || scale * move.norm() < 1e-8) break;
      x += scale * move;
      energy = next;
      if (x.norm() > 10.0 * kAwayMm) return x;
    }
  }
  return x;
}

}  // namespace

std::vector<TouchPoint> touch_points(const MeshQuery& at_rest, const MeshQuery& moving,
                                     const std::vector<bool>& moving_triangles, double reach_mm) {
  std::vector<Vector3> points;
  std::vector<double> area;
  Box box;
  for (const SurfaceSample& s : sample_surface(moving.mesh(), kStepMm, moving_triangles)) {
    points.push_back(s.p_mm);
    area.push_back(s.area_mm2);
    box.extend(s.p_mm);
  }
  std::vector<TouchPoint> out;
  const std::vector<SolidHit> hits = solid_hits(at_rest, points, reach_mm);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (std::isfinite(hits[i].distance_mm))
      out.push_back({points[i], hits[i].normal, hits[i].distance_mm, area[i]});

  // Cusps of the body at rest, which the samples may step over.
  const TriangleMesh& rest = at_rest.mesh();
  std::vector<double> share(rest.vertices_mm.size(), 0.0);
  for (std::size_t t = 0; t < rest.triangles.size(); ++t)
    for (const std::uint32_t v : rest.triangles[t]) share[v] += face_normal_scaled(rest, t).norm() / 6.0;
  points.clear();
  area.clear();
  for (std::size_t v = 0; v < share.size(); ++v) {
    const Vector3& p = rest.vertices_mm[v];
    if (share[v] <= 0.0 || (p.array() < box.min_mm.array() - reach_mm).any() ||
        (p.array() > box.max_mm.array() + reach_mm).any())
      continue;
    points.push_back(p);
    area.push_back(share[v]);
  }
  const std::vector<SolidHit> back = solid_hits(moving, points, reach_mm);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (std::isfinite(back[i].distance_mm))
      out.push_back({back[i].point_mm, -back[i].normal, back[i].distance_mm, area[i]});
  return out;
}

struct ElasticFoundation::Impl {
  Vector3 centre_mm;
  System system;
  std::vector<double> stiff_n_per_mm;
};

ElasticFoundation::ElasticFoundation(const std::vector<TouchPoint>& points, const Vector3& through_mm,
                                     double stiffness_n_per_mm3)
    : impl_(std::make_unique<Impl>()) {
  impl_->centre_mm = through_mm;
  System& system = impl_->system;
  std::vector<std::pair<double, std::uint32_t>> order;
  order.reserve(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) order.emplace_back(points[i].gap_mm, i);
  std::sort(order.begin(), order.end());
  system.rows.reserve(points.size());
  system.gaps.reserve(points.size());
  for (const auto& [gap_mm, i] : order) {
    const TouchPoint& t = points[i];
    system.rows.push_back(by_motion(t, through_mm));
    system.longest_row = std::max(system.longest_row, system.rows.back().norm());
    system.gaps.push_back(gap_mm);
    impl_->stiff_n_per_mm.push_back(stiffness_n_per_mm3 * t.area_mm2);
  }
}
ElasticFoundation::~ElasticFoundation() = default;

Settled ElasticFoundation::under(const Vector3& force_n) {
  System& system = impl_->system;
  const Vector3& centre = impl_->centre_mm;  // the force has no moment about it
  system.pull << Vector3::Zero(), force_n;
  const Jacobian x = minimum(system, impl_->stiff_n_per_mm);
  Settled out;
  const Vector3 turn = x.head<3>() / kLeverMm;
  out.motion = Rigid3{exp_so3(turn), centre + x.tail<3>() - exp_so3(turn) * centre};
  for (std::size_t i = 0, n = system.within(x); i < n; ++i)
    out.deepest_mm = std::max(out.deepest_mm, -(system.gaps[i] + system.rows[i].dot(x)));
  out.at_rest = x.norm() < kAwayMm;
  return out;
}

Settled settled(const std::vector<TouchPoint>& points, const PressingForce& force,
                double stiffness_n_per_mm3) {
  return ElasticFoundation(points, force.through_mm, stiffness_n_per_mm3).under(force.force_n);
}

}  // namespace gnathion
