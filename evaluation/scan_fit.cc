#include "evaluation/scan_fit.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "registration/coarse.h"
#include "registration/residual_noise.h"
#include "registration/robust_icp.h"
#include "registration/surface_samples.h"

namespace gnathion {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

constexpr double kScaleSigma = 0.01;  // prints are at least this true to size; what is known before the fit
constexpr double kGateMm = 2.0;

/// Pose, and size of the scan over the model about the model's centroid.
struct Similarity {
  Rigid3 model_from_scan;
  double scale = 1.0;
  Vector3 centre_mm = Vector3::Zero();  ///< in the model's frame

  Vector3 operator*(const Vector3& p) const { return centre_mm + (model_from_scan * p - centre_mm) / scale; }
};

/// Pairs of the scan as it would be at the model's size. Their source points are told in the model's frame,
/// after pose and size: the pose that is left to find is the identity.
std::vector<PlanePair> pairs_at(const Similarity& x, const SurfaceSamples& samples, const MeshQuery& model,
                                const std::vector<bool>& keep, double gate_mm) {
  SurfaceSamples placed = samples;
  for (std::size_t i = 0; i < placed.size(); ++i) {
    placed.points_mm[i] = x * samples.points_mm[i];
    placed.normals[i] = x.model_from_scan.rotation * samples.normals[i];
  }
  return associate(placed, model, keep, Rigid3::identity(), {gate_mm, 0.5});
}

/// ∂residual/∂(ω, v, ln(model's size over scan's)), about the centre.
Vector7 row_of(const PlanePair& p, const Vector3& centre) {
  Vector7 j;
  const Vector3 arm = p.source_mm - centre;
  j << arm.cross(p.normal), p.normal, p.normal.dot(arm);
  return j;
}

/// Gauss-Newton over pose and size, re-weighted and re-associated as robust_icp does.
struct ScaledFit {
  Similarity x;
  std::vector<PlanePair> pairs;
  double scale_mm = 0.0;
};
ScaledFit with_scale(const SurfaceSamples& samples, const MeshQuery& model, const std::vector<bool>& keep,
                     const Similarity& start, double noise_mm, int iterations) {
  ScaledFit fit{start, {}, 0.0};
  for (int i = 0; i <= iterations; ++i) {
    fit.pairs = pairs_at(fit.x, samples, model, keep, kGateMm);
    fit.scale_mm = robust_scale_mm(fit.pairs, Rigid3::identity(), noise_mm);
    weigh(fit.pairs, Rigid3::identity(), fit.scale_mm);
    if (i == iterations) break;
    Matrix7 h = Matrix7::Zero();
    Vector7 g = Vector7::Zero();
    for (const PlanePair& p : fit.pairs) {
      if (!(p.weight > 0.0)) continue;
      const Vector7 j = row_of(p, fit.x.centre_mm);
      h += p.weight * j * j.transpose();
      g += p.weight * j * p.residual_mm(Rigid3::identity());
    }
    const double known = std::pow(fit.scale_mm / kScaleSigma, 2);
    h(6, 6) += known;
    g(6) -= known * std::log(fit.x.scale);
    h.diagonal().head<6>().array() += 1e-9 * h.diagonal().maxCoeff();
    const Vector7 step = -h.ldlt().solve(g);
    const Rigid3 centred = Rigid3::from_translation(-fit.x.centre_mm);
    // The step was taken at the model's size; about the centre a turn is the same at both, a shift grows.
    Vector6 pose = step.head<6>();
    pose.tail<3>() *= fit.x.scale;
    fit.x.model_from_scan = centred.inverse() * exp_se3(pose) * centred * fit.x.model_from_scan;
    fit.x.scale *= std::exp(-step(6));
    if (step.head<3>().norm() * 30.0 + step.segment<3>(3).norm() + std::abs(step(6)) * 30.0 < 1e-5)
      iterations = i + 1;
  }
  return fit;
}

std::vector<bool> every_triangle(const TriangleMesh& mesh, const std::vector<bool>& vertices) {
  return triangles_of_mask(mesh, vertices);
}

struct Split {
  SurfaceSamples fitted, held_out;
};
/// Every fifth sample stays out of the fit.
Split split_samples(const TriangleMesh& scan, const std::vector<bool>& keep, const ScanFitOptions& options) {
  const SurfaceSamples all = sample_surface(scan, keep, options.points * 5 / 4, options.seed);
  Split s;
  for (std::size_t i = 0; i < all.size(); ++i)
    (i % 5 == 4 ? s.held_out : s.fitted).push_back(all.points_mm[i], all.normals[i], all.triangles[i]);
  return s;
}

Result<Rigid3> starting_pose(const TriangleMesh& scan, const TriangleMesh& model, const MeshQuery& query,
                             const std::vector<bool>& keep_scan, const std::vector<bool>& keep_model,
                             const ScanFitOptions& options) {
  if (options.guess) return *options.guess;
  CoarseOptions coarse;
  coarse.overlap = options.overlap;
  coarse.noise_mm = options.noise_mm;
  coarse.seed = options.seed;
  coarse.name = options.name;
  GNATHION_TRY(const CoarseMatch match, find_pose({&scan, keep_scan}, {&model, keep_model}, query, coarse));
  return match.target_from_source;
}

/// Covariance of the pose (left, in the model's frame), size a nuisance; and the report's figures.
Status describe(const ScaledFit& fit, const SurfaceSamples& held_out, const MeshQuery& model,
                const std::vector<bool>& keep, bool scaled, const std::string& name, FitReport* report) {
  const Rigid3 identity = Rigid3::identity();
  report->rms_mm = weighted_rms_mm(fit.pairs, identity);
  std::vector<PlanePair> unseen = pairs_at(fit.x, held_out, model, keep, kGateMm);
  weigh(unseen, identity, fit.scale_mm);
  report->held_out_mm = weighted_rms_mm(unseen, identity);

  const int unknowns = scaled ? 7 : 6;
  ScoreRows rows(unknowns, static_cast<Eigen::Index>(fit.pairs.size()));
  Matrix7 h = Matrix7::Zero();
  for (std::size_t i = 0; i < fit.pairs.size(); ++i) {
    const Vector7 j = row_of(fit.pairs[i], fit.x.centre_mm);
    rows.col(static_cast<Eigen::Index>(i)) = j.head(unknowns);
    h += fit.pairs[i].weight * j * j.transpose();
  }
  h(6, 6) += scaled ? std::pow(fit.scale_mm / kScaleSigma, 2) : 1.0;
  if (!scaled) h.col(6).head<6>().setZero(), h.row(6).head<6>().setZero();
  const Eigen::FullPivLU<Matrix7> lu(h);
  if (!lu.isInvertible()) return bad_input("cannot align", name, "undetermined: the surface slides");
  const Eigen::MatrixXd bread = lu.inverse().topLeftCorner(6, unknowns);
  const ResidualNoise noise = estimate_noise(fit.pairs, identity);
  Matrix6 about_centre = bread * score_covariance(fit.pairs, rows, noise) * bread.transpose();
  about_centre = 0.5 * (about_centre + about_centre.transpose()).eval();
  const Matrix6 to_frame = adjoint(Rigid3::from_translation(fit.x.centre_mm));
  report->covariance = to_frame * about_centre * to_frame.transpose();
  const Conditioning c = conditioning(fit.pairs, identity, report->covariance);
  report->condition = c.condition;
  report->weak = c.weak;
  return {};
}

}  // namespace

Result<ScanFit> fit_scan(const TriangleMesh& scan, const TriangleMesh& model, const MeshQuery& query,
                         const ScanFitOptions& options) {
  const std::vector<bool> keep_scan = every_triangle(scan, options.scan_vertices);
  const std::vector<bool> keep_model = every_triangle(model, options.model_vertices);
  if (!(kept_area_mm2(scan, keep_scan) > 0.0) || !(kept_area_mm2(model, keep_model) > 0.0))
    return bad_input("cannot align", options.name, "undetermined: nothing to fit");
  GNATHION_TRY(const Rigid3 start, starting_pose(scan, model, query, keep_scan, keep_model, options));

  const Split samples = split_samples(scan, keep_scan, options);
  IcpOptions icp;
  icp.first_gate_mm = options.guess ? 5.0 : 2.0;
  icp.last_gate_mm = kGateMm;
  icp.noise_mm = options.noise_mm / 3.0;
  const IcpResult rigid = robust_icp(samples.fitted, query, keep_model, start, icp);
  if (rigid.pairs.size() < 30) return bad_input("cannot align", options.name, "undetermined: no counterpart");

  // The last steps, with the size free or fixed; a rigid fit takes none of them.
  Similarity x{rigid.target_from_source, 1.0, surface_centroid_mm(model)};
  const ScaledFit fit =
      with_scale(samples.fitted, query, keep_model, x, options.noise_mm / 3.0, options.with_scale ? 20 : 0);
  ScanFit result;
  result.model_from_scan = fit.x.model_from_scan;
  result.report.region = options.region;
  result.report.scale = fit.x.scale;
  for (const PlanePair& p : fit.pairs) result.report.points += p.weight > 0.0 ? 1 : 0;
  result.report.inlier_fraction = static_cast<double>(result.report.points) /
                                  static_cast<double>(std::max<std::size_t>(1, samples.fitted.size()));
  if (result.report.inlier_fraction < 0.5 * options.overlap || result.report.points < 30)
    return bad_input(
        "cannot align", options.name,
        fmt::format("undetermined: {:.0f} % of the surface finds a counterpart, {:.0f} % are needed",
                    100.0 * result.report.inlier_fraction, 50.0 * options.overlap));
  GNATHION_CHECK_OK(
      describe(fit, samples.held_out, query, keep_model, options.with_scale, options.name, &result.report));
  return result;
}

double mean_distance_mm(const TriangleMesh& scan, const MeshQuery& model, const Rigid3& model_from_scan,
                        double cap_mm) {
  const SurfaceSamples samples = sample_surface(scan, triangles_of_mask(scan, {}), 4000, 1);
  std::vector<double> distance(samples.size(), cap_mm);
  tbb::parallel_for(std::size_t{0}, samples.size(), [&](std::size_t i) {
    const auto found = model.closest(model_from_scan * samples.points_mm[i], cap_mm);
    if (found) distance[i] = found->distance_mm;
  });
  double sum = 0.0;
  for (double d : distance) sum += d;
  return samples.size() > 0 ? sum / static_cast<double>(samples.size()) : cap_mm;
}

}  // namespace gnathion
