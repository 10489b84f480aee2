#include "registration/align.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>

#include "core/mesh_query.h"
#include "registration/coarse.h"
#include "registration/mirrored.h"
#include "registration/residual_noise.h"
#include "registration/robust_icp.h"
#include "registration/surface_samples.h"

namespace gnathion {
namespace {

constexpr double kLeastSupport = 0.5;  // of the expected overlap

/// Every fifth sample is kept out of the fit.
void split_held_out(const SurfaceSamples& all, SurfaceSamples* fitted, SurfaceSamples* held_out) {
  for (std::size_t i = 0; i < all.size(); ++i) {
    (i % 5 == 4 ? held_out : fitted)->push_back(all.points_mm[i], all.normals[i], all.triangles[i]);
  }
}

/// RMS of points that the fit never saw, over those that the loss would not reject outright.
double held_out_rms_mm(const SurfaceSamples& held_out, const MeshQuery& target, const std::vector<bool>& keep,
                       const IcpResult& fit, double gate_mm) {
  std::vector<PlanePair> pairs = associate(held_out, target, keep, fit.target_from_source, {gate_mm, 0.5});
  weigh(pairs, fit.target_from_source, fit.scale_mm);
  return weighted_rms_mm(pairs, fit.target_from_source);
}

Vector3 centroid_of(const SurfaceSamples& samples) {
  Vector3 sum = Vector3::Zero();
  for (const Vector3& p : samples.points_mm) sum += p;
  return sum / static_cast<double>(std::max<std::size_t>(1, samples.size()));
}

Result<Alignment> align_as_they_are(const TriangleMesh& source, const TriangleMesh& target,
                                    const AlignOptions& options) {
  const std::vector<bool> keep_source = triangles_of_mask(source, options.source_vertex_mask);
  const std::vector<bool> keep_target = triangles_of_mask(target, options.target_vertex_mask);
  if (source.empty() || target.empty()) return bad_input("cannot align", options.name, "an empty surface");
  const MeshQuery query(target);

  // Coarse: the given guess, or a search over all poses.
  Rigid3 start;
  if (options.initial_target_from_source) {
    start = *options.initial_target_from_source;
  } else {
    CoarseOptions coarse;
    coarse.overlap = options.overlap;
    coarse.noise_mm = options.noise_mm;
    coarse.seed = options.seed;
    coarse.name = options.name;
    GNATHION_TRY(const CoarseMatch match,
                 find_pose({&source, keep_source}, {&target, keep_target}, query, coarse));
    start = match.target_from_source;
  }

  // Fine: robust point-to-plane on points that are spread evenly over the surface.
  SurfaceSamples fitted, held_out;
  split_held_out(sample_surface(source, keep_source, options.points * 5 / 4, options.seed), &fitted,
                 &held_out);
  IcpOptions icp;
  icp.first_gate_mm = options.initial_target_from_source ? 5.0 : std::max(1.5, options.gate_mm);
  icp.last_gate_mm = options.gate_mm;
  icp.noise_mm = options.noise_mm / 3.0;
  IcpResult fit = robust_icp(fitted, query, keep_target, start, icp);

  // What the fit says about itself.
  Alignment result;
  result.target_from_source = fit.target_from_source;
  double support = 0.0;
  for (const PlanePair& p : fit.pairs) {
    support += p.weight > 0.0 ? 1.0 : 0.0;
    result.points += p.weight > 0.0 ? 1 : 0;
  }
  result.inlier_fraction = fitted.size() > 0 ? support / static_cast<double>(fitted.size()) : 0.0;
  if (result.inlier_fraction < kLeastSupport * options.overlap || result.points < 30) {
    return bad_input(
        "cannot align", options.name,
        fmt::format("undetermined: {:.0f} % of the surface finds a counterpart, {:.0f} % are needed",
                    100.0 * result.inlier_fraction, 100.0 * kLeastSupport * options.overlap));
  }
  if (!fit.converged) return bad_input("cannot align", options.name, "undetermined: the fit does not settle");
  result.rms_mm = weighted_rms_mm(fit.pairs, fit.target_from_source);
  result.held_out_mm = held_out_rms_mm(held_out, query, keep_target, fit, options.gate_mm);

  const Matrix6 h = information(fit.pairs, fit.target_from_source);
  const Eigen::FullPivLU<Matrix6> lu(h);
  if (!lu.isInvertible()) return bad_input("cannot align", options.name, "undetermined: the surface slides");
  const Matrix6 bread = lu.inverse();
  const ResidualNoise noise = estimate_noise(fit.pairs, fit.target_from_source);
  const Vector6 by_scale = bread * source_scale_score(fit.pairs, fit.target_from_source, centroid_of(fitted));
  result.covariance = bread * score_covariance(fit.pairs, fit.target_from_source, noise) * bread +
                      options.scale_sigma * options.scale_sigma * by_scale * by_scale.transpose();
  result.covariance = 0.5 * (result.covariance + result.covariance.transpose()).eval();
  result.noise_sigma_mm = noise.white_sigma_mm();
  result.correlated_sigma_mm = noise.correlated_sigma_mm();
  result.correlation_length_mm = noise.length_mm();
  const Conditioning conditions = conditioning(fit.pairs, fit.target_from_source, result.covariance);
  result.condition = conditions.condition;
  result.weak = conditions.weak;
  return result;
}

/// A match that two scans of one body do not give: residuals far above the noise, or little in common.
bool doubtful(const Alignment& a, const AlignOptions& options) {
  return a.rms_mm > 3.0 * options.noise_mm || a.inlier_fraction < 0.75 * options.overlap;
}

}  // namespace

Result<Alignment> align_surfaces(const TriangleMesh& source, const TriangleMesh& target,
                                 const AlignOptions& options) {
  Result<Alignment> direct = align_as_they_are(source, target, options);
  const bool searched = !options.initial_target_from_source && !source.empty() && !target.empty();
  if (!searched || (direct && !doubtful(*direct, options))) return direct;
  const Result<Alignment> reflected = align_as_they_are(mirrored(source), target, options);
  if (!reflected || doubtful(*reflected, options)) return direct;
  if (!direct || reflected->rms_mm < 0.5 * direct->rms_mm)
    return bad_input("cannot align", options.name, kMirroredWhy);
  return direct;
}

}  // namespace gnathion
