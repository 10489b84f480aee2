#include "calibration/chain_score.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "calibration/se3_manifold.h"

namespace gnathion {
namespace {

using RowMatrix67 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

/// How the residual changes with the scale of its source and of its surface. Both at the surface's point:
/// with the source's own, their sum would hold the residual itself, which shrinking both could then explain
/// away.
double by_source_scale(const SurfaceTerm& term, const PlanePair& p, const Rigid3& x) {
  return -p.normal.dot(p.target_mm - x * term.scale_centre_mm);
}
double by_surface_scale(const SurfaceTerm& term, const PlanePair& p) {
  return p.normal.dot(p.target_mm - term.surface_scale_centre_mm);
}
double by_scale(const SurfaceTerm& term, int scanner, const PlanePair& p, const Rigid3& x) {
  double d = 0.0;
  if (term.scanner == scanner) d += by_source_scale(term, p, x);
  if (term.surface_scanner == scanner) d += by_surface_scale(term, p);
  return d;
}

/// Jacobians of all pairs by (ξ, δs), a column each.
ScoreRows rows_of(const SurfaceTerm& term, const Rigid3& x, const std::vector<int>& scanners) {
  ScoreRows rows(6 + static_cast<long>(scanners.size()), static_cast<long>(term.pairs.size()));
  for (std::size_t i = 0; i < term.pairs.size(); ++i) {
    const PlanePair& p = term.pairs[i];
    const auto column = static_cast<long>(i);
    rows.col(column).head<6>() = p.jacobian(x);
    for (std::size_t k = 0; k < scanners.size(); ++k)
      rows(6 + static_cast<long>(k), column) = by_scale(term, scanners[k], p, x);
  }
  return rows;
}

/// L⁻¹ of a covariance, its unknowns scaled to like size; a direction that nothing measures stays finite.
Eigen::MatrixXd whitening(const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd scale =
      covariance.diagonal().cwiseMax(1e-12 * covariance.diagonal().maxCoeff()).cwiseSqrt();
  Eigen::MatrixXd even = scale.cwiseInverse().asDiagonal() * covariance * scale.cwiseInverse().asDiagonal();
  even.diagonal().array() += 1e-10;
  const Eigen::MatrixXd lower = Eigen::LLT<Eigen::MatrixXd>(even).matrixL();
  return lower.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd(scale.cwiseInverse().asDiagonal()));
}

}  // namespace

std::vector<int> scanners_of(const SurfaceTerm& term) {
  std::vector<int> out;
  if (term.scanner >= 0) out.push_back(term.scanner);
  if (term.surface_scanner >= 0 && term.surface_scanner != term.scanner) out.push_back(term.surface_scanner);
  return out;
}

namespace {

TermScore score_at(const SurfaceTerm& term, const Rigid3& pose) {
  TermScore s;
  s.at = pose;
  s.scanners = scanners_of(term);
  for (const int k : s.scanners)
    s.scales_at.push_back(k == term.scanner ? term.source_scale : term.surface_scale);
  return s;
}

ScoreRows rows_of(const SurfaceTerm& term, const Rigid3& pose) {
  return rows_of(term, pose, scanners_of(term));
}

}  // namespace

TermScore generalised_score_of(const SurfaceTerm& term, const Rigid3& pose) {
  TermScore s = score_at(term, pose);
  GeneralisedScore score = term.patches->score(term.pairs, pose, rows_of(term, pose));
  s.information = std::move(score.information);
  s.score = std::move(score.score);
  s.weight = 1.0 / term.widened;
  return s;
}

Disagreement disagreement_of(const SurfaceTerm& term, const Rigid3& pose,
                             const std::vector<double>& scale_sigmas) {
  const std::vector<int> scanners = scanners_of(term);
  Eigen::VectorXd sigmas(static_cast<long>(scanners.size()));
  for (std::size_t k = 0; k < scanners.size(); ++k)
    sigmas[static_cast<long>(k)] = scale_sigmas[static_cast<std::size_t>(scanners[k])];
  return term.patches->disagreement(term.pairs, pose, rows_of(term, pose), sigmas);
}

ShapeFit shape_fit_of(const SurfaceTerm& term, const Rigid3& pose) {
  return {term.patches.get(), &term.pairs, pose, rows_of(term, pose)};
}

ShapeModes shape_modes_of(const MeshQuery& surface) {
  const Box box = bounding_box(surface.mesh());
  return {box.centre_mm(), 0.5 * box.size_mm().maxCoeff()};
}

Eigen::MatrixXd score_by_shape(const SurfaceTerm& term, const Rigid3& pose) {
  const ScoreRows rows = rows_of(term, pose);
  const Eigen::MatrixXd along = term.shape->modes.along(term.pairs);
  if (term.generalised) return -term.patches->cross(term.pairs, pose, rows, along);
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows.rows(), along.rows());
  for (std::size_t i = 0; i < term.pairs.size(); ++i) {
    const auto k = static_cast<long>(i);
    if (term.pairs[i].weight > 0.0) out -= term.pairs[i].weight * rows.col(k) * along.col(k).transpose();
  }
  return out;
}

TermScore score_of(const SurfaceTerm& term, const Rigid3& pose) {
  TermScore s = score_at(term, pose);
  const ScoreRows rows = rows_of(term, pose, s.scanners);
  s.information = Eigen::MatrixXd::Zero(rows.rows(), rows.rows());
  s.score = Eigen::VectorXd::Zero(rows.rows());
  for (std::size_t i = 0; i < term.pairs.size(); ++i) {
    const PlanePair& p = term.pairs[i];
    if (!(p.weight > 0.0)) continue;
    const auto j = rows.col(static_cast<long>(i));
    s.information.noalias() += p.weight * j * j.transpose();
    s.score += p.weight * p.residual_mm(pose) * j;
  }
  s.weight = 1.0 / (term.scale_mm * term.scale_mm);
  return s;
}

Eigen::MatrixXd score_noise(const SurfaceTerm& term, const Rigid3& pose) {
  return term.widened * score_covariance(term.pairs, rows_of(term, pose, scanners_of(term)), term.noise);
}

double score_weight(const TermScore& score, const Eigen::MatrixXd& noise) {
  const Matrix6 whiten = whitening(score.information.topLeftCorner<6, 6>());
  const double mean = (whiten * noise.topLeftCorner<6, 6>() * whiten.transpose()).trace() / 6.0;
  return 1.0 / std::max(mean, 1e-12);
}

ScoreCost::ScoreCost(const TermScore& score, bool has_left)
    : at_(score.at), scales_at_(score.scales_at), has_left_(has_left) {
  const Eigen::MatrixXd whiten = std::sqrt(score.weight) * whitening(score.information);
  slope_ = whiten * score.information;
  offset_ = whiten * score.score;
  set_num_residuals(static_cast<int>(offset_.size()));
  for (int k = 0; k < (has_left ? 2 : 1); ++k) mutable_parameter_block_sizes()->push_back(7);
  for (std::size_t k = 0; k < scales_at_.size(); ++k) mutable_parameter_block_sizes()->push_back(1);
}

bool ScoreCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Rigid3 a = has_left_ ? rigid_from_parameters(parameters[0]) : Rigid3::identity();
  const std::size_t right = has_left_ ? 1 : 0;
  Eigen::VectorXd moved(offset_.size());
  moved.head<6>() = difference(a.inverse() * rigid_from_parameters(parameters[right]), at_);
  for (std::size_t k = 0; k < scales_at_.size(); ++k)
    moved[6 + static_cast<long>(k)] = parameters[right + 1 + k][0] - scales_at_[k];
  Eigen::Map<Eigen::VectorXd>(residuals, offset_.size()) = slope_ * moved + offset_;
  if (jacobians == nullptr) return true;
  // X = A⁻¹B: exp(b) on B moves X by Ad_{A⁻¹}b, exp(a) on A by −Ad_{A⁻¹}a. The logarithm's own derivative is
  // 1 where it counts: rounds are repeated until X stands still at its `at`. Ceres multiplies by the
  // manifold's PlusJacobian; MinusJacobian is its left inverse.
  const Se3Manifold manifold;
  const Eigen::MatrixXd by_pose = slope_.leftCols<6>() * adjoint(a.inverse());
  const auto put_pose = [&](std::size_t block, double sign) {
    if (jacobians[block] == nullptr) return;
    RowMatrix67 lift;
    manifold.MinusJacobian(parameters[block], lift.data());
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 7, Eigen::RowMajor>>(jacobians[block], offset_.size(),
                                                                          7) = sign * by_pose * lift;
  };
  if (has_left_) put_pose(0, -1.0);
  put_pose(right, 1.0);
  for (std::size_t k = 0; k < scales_at_.size(); ++k)
    if (jacobians[right + 1 + k] != nullptr)
      Eigen::Map<Eigen::VectorXd>(jacobians[right + 1 + k], offset_.size()) =
          slope_.col(6 + static_cast<long>(k));
  return true;
}

KnownPoseCost::KnownPoseCost(const KnownPose& known)
    : value_(known.value), whiten_(whitening(known.covariance)) {}

bool KnownPoseCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  Eigen::Map<Vector6>(residuals, 6) = whiten_ * difference(rigid_from_parameters(parameters[0]), value_);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    RowMatrix67 lift;
    Se3Manifold().MinusJacobian(parameters[0], lift.data());
    Eigen::Map<RowMatrix67> out(jacobians[0]);
    out = whiten_ * lift;
  }
  return true;
}

bool ScalePrior::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  residuals[0] = parameters[0][0] / sigma_;
  if (jacobians != nullptr && jacobians[0] != nullptr) jacobians[0][0] = 1.0 / sigma_;
  return true;
}

}  // namespace gnathion
