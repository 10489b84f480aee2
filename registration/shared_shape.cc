#include "registration/shared_shape.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

namespace gnathion {

Eigen::Matrix<double, ShapeModes::kCount, 1> ShapeModes::along(const Vector3& normal,
                                                               const Vector3& p_mm) const {
  const Vector3 at = (p_mm - centre_mm) / radius_mm;
  const double x = at.x(), y = at.y(), z = at.z();
  Eigen::Matrix<double, kCount, 1> out;
  out.head<6>() << normal.x() * x, normal.y() * y, normal.z() * z, normal.x() * y + normal.y() * x,
      normal.y() * z + normal.z() * y, normal.z() * x + normal.x() * z;
  const double squares[6] = {x * x, y * y, z * z, x * y, y * z, z * x};
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 6; ++k) out[6 + 6 * axis + k] = normal[axis] * squares[k];
  return out;
}

Eigen::MatrixXd ShapeModes::along(const std::vector<PlanePair>& pairs) const {
  Eigen::MatrixXd out(kCount, static_cast<long>(pairs.size()));
  for (std::size_t i = 0; i < pairs.size(); ++i)
    out.col(static_cast<long>(i)) = along(pairs[i].normal, pairs[i].target_mm);
  return out;
}

SharedShape shared_shape(const std::vector<ShapeFit>& fits, const ShapeModes& modes) {
  constexpr double kTells = 1e-4;  // of the best known mode's information
  SharedShape out;
  if (fits.size() < 2) return out;
  std::vector<GeneralisedScore> scores;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(ShapeModes::kCount, ShapeModes::kCount);
  Eigen::MatrixXd along;
  for (const ShapeFit& fit : fits) {
    along = modes.along(*fit.pairs);
    scores.push_back(fit.patches->score_beside(*fit.pairs, fit.target_from_source, fit.rows, along));
    information += scores.back().information;
  }
  // In coordinates in which all fits together know every mode equally well.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(information);
  const double most = solver.eigenvalues().maxCoeff();
  if (!(most > 0.0)) return out;
  long first = 0;
  while (solver.eigenvalues()[first] < kTells * most) ++first;
  out.freedom = static_cast<int>(ShapeModes::kCount - first);
  const Eigen::MatrixXd even = solver.eigenvectors().rightCols(out.freedom) *
                               solver.eigenvalues().tail(out.freedom).cwiseSqrt().cwiseInverse().asDiagonal();
  Eigen::VectorXd common = Eigen::VectorXd::Zero(out.freedom);
  double each = 0.0;
  for (const GeneralisedScore& s : scores) {
    const Eigen::VectorXd score = even.transpose() * s.score;
    const Eigen::MatrixXd own =
        even.transpose() * s.information * even + 1e-6 * Eigen::MatrixXd::Identity(out.freedom, out.freedom);
    each += score.dot(own.ldlt().solve(score));
    common += score;
  }
  const double apart = std::max(each - common.squaredNorm(), 1e-12);
  out.ratio = common.squaredNorm() * static_cast<double>(fits.size() - 1) / apart;
  const Eigen::VectorXd deformation = even * common;  // minus what the residuals show: only its size counts
  out.bent_mm =
      std::sqrt((along.transpose() * deformation).squaredNorm() / static_cast<double>(along.cols()));
  return out;
}

BodyShape estimated_shape(const std::vector<ShapeFit>& fits, const ShapeModes& modes, double sigma_mm,
                          const BodyShape* taken_out) {
  Eigen::MatrixXd information =
      Eigen::MatrixXd::Identity(ShapeModes::kCount, ShapeModes::kCount) / (sigma_mm * sigma_mm);
  Eigen::VectorXd score = Eigen::VectorXd::Zero(ShapeModes::kCount);
  for (const ShapeFit& fit : fits) {
    const GeneralisedScore s =
        fit.patches->score_beside(*fit.pairs, fit.target_from_source, fit.rows, modes.along(*fit.pairs));
    information += s.information;
    score += s.score;
    if (taken_out) score += s.information * taken_out->sizes_mm;
  }
  BodyShape out;
  out.modes = modes;
  out.covariance_mm2 =
      information.ldlt().solve(Eigen::MatrixXd::Identity(ShapeModes::kCount, ShapeModes::kCount));
  out.sizes_mm = out.covariance_mm2 * score;
  const Eigen::MatrixXd along = modes.along(*fits.front().pairs);
  out.bent_mm =
      std::sqrt((along.transpose() * out.sizes_mm).squaredNorm() / static_cast<double>(along.cols()));
  return out;
}

}  // namespace gnathion
