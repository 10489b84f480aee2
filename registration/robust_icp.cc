#include "registration/robust_icp.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>

namespace gnathion {
namespace {

constexpr double kTukey = 4.685;  // 95 % efficiency under normal noise

/// One Gauss–Newton step on SE(3) about the pairs' centroid, where rotation and translation hardly mix; a
/// direction without information is left alone.
Rigid3 gauss_newton_step(const std::vector<PlanePair>& pairs, const Rigid3& x, double* moved_mm) {
  Vector3 centre = Vector3::Zero();
  double total = 0.0;
  for (const PlanePair& p : pairs) {
    centre += p.weight * (x * p.source_mm);
    total += p.weight;
  }
  *moved_mm = 0.0;
  if (!(total > 0.0)) return x;
  centre /= total;
  double radius2 = 0.0;
  for (const PlanePair& p : pairs) radius2 += p.weight * (x * p.source_mm - centre).squaredNorm();
  const double radius = std::max(1.0, std::sqrt(radius2 / total));

  Matrix6 h = Matrix6::Zero();
  Vector6 g = Vector6::Zero();
  for (const PlanePair& p : pairs) {
    if (!(p.weight > 0.0)) continue;
    Vector6 j;
    j << (x * p.source_mm - centre).cross(p.normal) / radius, p.normal;
    h += p.weight * j * j.transpose();
    g += p.weight * j * p.residual_mm(x);
  }
  h.diagonal().array() += 1e-6 * h.diagonal().maxCoeff();
  Vector6 step = -h.ldlt().solve(g);
  *moved_mm = step.head<3>().norm() + step.tail<3>().norm();
  step.head<3>() /= radius;
  const Rigid3 to_centre = Rigid3::from_translation(-centre);
  return to_centre.inverse() * exp_se3(step) * to_centre * x;
}

}  // namespace

std::vector<PlanePair> associate(const SurfaceSamples& source, const MeshQuery& target,
                                 const std::vector<bool>& keep_target, const Rigid3& target_from_source,
                                 const AssociationOptions& options) {
  std::vector<std::optional<PlanePair>> found(source.size());
  tbb::parallel_for(std::size_t{0}, source.size(), [&](std::size_t i) {
    const Vector3 p = target_from_source * source.points_mm[i];
    const auto closest = target.closest(p, options.gate_mm);
    if (!closest || closest->on_boundary) return;
    if (!keep_target.empty() && !keep_target[closest->triangle]) return;
    const Vector3 facing = target_from_source.rotation * source.normals[i];
    if (facing.dot(closest->normal) < options.min_normal_cosine) return;
    found[i] = PlanePair{source.points_mm[i], closest->point_mm, closest->normal,
                         static_cast<std::uint32_t>(i), 1.0};
  });
  std::vector<PlanePair> pairs;
  for (const auto& f : found) {
    if (f) pairs.push_back(*f);
  }
  return pairs;
}

double robust_scale_mm(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                       double floor_mm) {
  if (pairs.empty()) return floor_mm;
  std::vector<double> sizes;
  for (const PlanePair& p : pairs) sizes.push_back(std::abs(p.residual_mm(target_from_source)));
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return std::max(floor_mm, 1.4826 * *middle);
}

void weigh(std::vector<PlanePair>& pairs, const Rigid3& target_from_source, double scale_mm) {
  for (PlanePair& p : pairs) {
    const double u = p.residual_mm(target_from_source) / (kTukey * scale_mm);
    p.weight = std::abs(u) < 1.0 ? (1.0 - u * u) * (1.0 - u * u) : 0.0;
  }
}

Matrix6 information(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source) {
  Matrix6 h = Matrix6::Zero();
  for (const PlanePair& p : pairs) {
    const Vector6 j = p.jacobian(target_from_source);
    h += p.weight * j * j.transpose();
  }
  return h;
}

Rigid3 plane_step(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source) {
  double moved_mm = 0.0;
  return gauss_newton_step(pairs, target_from_source, &moved_mm);
}

IcpResult robust_icp(const SurfaceSamples& source, const MeshQuery& target,
                     const std::vector<bool>& keep_target, const Rigid3& start, const IcpOptions& options) {
  IcpResult result;
  result.target_from_source = start;
  double gate = options.first_gate_mm;
  int settled = 0;
  for (int i = 0; i < options.max_iterations; ++i) {
    Rigid3& x = result.target_from_source;
    result.pairs = associate(source, target, keep_target, x, {gate, options.min_normal_cosine});
    if (result.pairs.size() < 6) return result;
    result.scale_mm = robust_scale_mm(result.pairs, x, options.noise_mm);
    weigh(result.pairs, x, result.scale_mm);
    double moved_mm = 0.0;
    x = gauss_newton_step(result.pairs, x, &moved_mm);
    // The gate follows the fit down, but never cuts into its noise.
    const double next_gate = std::max(options.last_gate_mm, std::min(0.8 * gate, 8.0 * result.scale_mm));
    settled = moved_mm < options.settled_mm && next_gate >= 0.99 * gate ? settled + 1 : 0;
    gate = next_gate;
    if (settled >= 2) {
      result.converged = true;
      break;
    }
  }
  result.pairs =
      associate(source, target, keep_target, result.target_from_source, {gate, options.min_normal_cosine});
  result.scale_mm = robust_scale_mm(result.pairs, result.target_from_source, options.noise_mm);
  weigh(result.pairs, result.target_from_source, result.scale_mm);
  return result;
}

}  // namespace gnathion
