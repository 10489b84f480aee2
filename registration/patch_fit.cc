#include "registration/patch_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>
#include <map>

namespace gnathion {
namespace {

constexpr std::size_t kMaxPatches = 700;   // a Cholesky factor of as many takes 50 ms
constexpr double kPatchOfRange = 1.0 / 3;  // correlated error changes by a twentieth over it
constexpr double kTooRare = 1e-3;          // models that explain less of the correlated variance than that
constexpr double kLeastOwn = 0.01;  // of the correlated variance that each patch has to itself at least

struct Patch {
  Vector3 sum_mm = Vector3::Zero(), normals = Vector3::Zero();
  double weight = 0.0, residual = 0.0;
  Eigen::VectorXd row;
};

/// The axis that a normal is nearest to, with its sign: 0 to 5.
int facing(const Vector3& normal) {
  int axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  return 2 * axis + (normal[axis] < 0.0 ? 1 : 0);
}

std::vector<Patch> gathered(const std::vector<PlanePair>& pairs, const Rigid3& x, const ScoreRows& rows,
                            double size_mm) {
  for (;; size_mm *= 1.15) {
    std::map<std::array<int, 4>, Patch> patches;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const PlanePair& p = pairs[i];
      if (!(p.weight > 0.0)) continue;
      const Eigen::Vector3i at = (p.target_mm / size_mm).array().floor().cast<int>();
      const auto [it, fresh] = patches.try_emplace({at.x(), at.y(), at.z(), facing(p.normal)});
      Patch& patch = it->second;
      if (fresh) patch.row = Eigen::VectorXd::Zero(rows.rows());
      patch.sum_mm += p.weight * p.target_mm;
      patch.normals += p.weight * p.normal;
      patch.weight += p.weight;
      patch.residual += p.weight * p.residual_mm(x);
      patch.row += p.weight * rows.col(static_cast<long>(i));
    }
    if (patches.size() > kMaxPatches) continue;
    std::vector<Patch> out;
    for (const auto& [key, patch] : patches) out.push_back(patch);
    return out;
  }
}

/// Of the mean residuals, averaged over the models that the residuals allow.
Eigen::MatrixXd covariance_of(const std::vector<Patch>& patches, const ResidualNoise& noise) {
  const auto n = static_cast<long>(patches.size());
  Eigen::Matrix3Xd at(3, n), normal(3, n);
  for (long i = 0; i < n; ++i) {
    const Patch& p = patches[static_cast<std::size_t>(i)];
    at.col(i) = p.sum_mm / p.weight;
    normal.col(i) = p.normals / p.weight;
  }
  std::map<std::pair<double, bool>, double> variances;
  const double correlated = noise.correlated_sigma_mm() * noise.correlated_sigma_mm();
  for (const ResidualNoise::Model& m : noise.models)
    variances[{m.length_mm, m.vector_field}] += m.probability * m.correlated_sigma_mm * m.correlated_sigma_mm;
  Eigen::MatrixXd v = Eigen::MatrixXd::Zero(n, n);
  for (long k = 0; k < n; ++k) {
    const long below = n - k;
    const Eigen::ArrayXd distance2 =
        (at.rightCols(below).colwise() - at.col(k)).colwise().squaredNorm().transpose().array();
    const Eigen::ArrayXd cosine = (normal.rightCols(below).transpose() * normal.col(k)).array();
    for (const auto& [kind, variance] : variances) {
      if (variance < kTooRare * correlated) continue;
      const Eigen::ArrayXd alike = variance * (-distance2 / (2.0 * kind.first * kind.first)).exp();
      v.col(k).tail(below).array() += kind.second ? Eigen::ArrayXd(alike * cosine) : alike;
    }
  }
  v.triangularView<Eigen::StrictlyUpper>() = v.transpose();
  const double white = noise.white_sigma_mm() * noise.white_sigma_mm();
  for (long k = 0; k < n; ++k)
    v(k, k) += white / patches[static_cast<std::size_t>(k)].weight + kLeastOwn * correlated + 1e-12;
  return v;
}

}  // namespace

PatchSystem patches_of(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                       const ScoreRows& rows, const ResidualNoise& noise) {
  const double size_mm = std::max(0.3, kPatchOfRange * noise.length_mm());
  const std::vector<Patch> patches = gathered(pairs, target_from_source, rows, size_mm);
  const auto n = static_cast<long>(patches.size());
  PatchSystem s;
  s.residual_mm.resize(n);
  s.weight.resize(n);
  s.jacobian.resize(n, rows.rows());
  for (long i = 0; i < n; ++i) {
    const Patch& p = patches[static_cast<std::size_t>(i)];
    s.residual_mm[i] = p.residual / p.weight;
    s.jacobian.row(i) = p.row.transpose() / p.weight;
    s.weight[i] = p.weight;
  }
  s.covariance = covariance_of(patches, noise);
  return s;
}

GeneralisedScore generalised_score(const PatchSystem& patches) {
  const Eigen::LLT<Eigen::MatrixXd> v(patches.covariance);
  const Eigen::MatrixXd j = v.matrixL().solve(patches.jacobian);
  const Eigen::VectorXd r = v.matrixL().solve(patches.residual_mm);
  return {j.transpose() * j, j.transpose() * r};
}

namespace {

void add_rest(const PatchSystem& patches, const Eigen::LLT<Eigen::MatrixXd>& v, Disagreement* out) {
  const Eigen::MatrixXd j = v.matrixL().solve(patches.jacobian);
  const Eigen::VectorXd r = v.matrixL().solve(patches.residual_mm);
  const Eigen::VectorXd rest = r - j * j.householderQr().solve(r);
  out->rest_chi2 = rest.squaredNorm();
  out->rest_freedom = static_cast<int>(r.size() - j.cols());
}

}  // namespace

Disagreement disagreement(const PatchSystem& patches, const Eigen::VectorXd& other_sigmas) {
  constexpr double kTells = 0.02;  // of the ordinary variance: less is rounding
  const Eigen::MatrixXd pose = patches.jacobian.leftCols<6>();
  const Eigen::MatrixXd others = patches.jacobian.rightCols(other_sigmas.size()) * other_sigmas.asDiagonal();
  // ξ = −A·r for the one, −G·r for the other; columns scaled alike, which χ² does not feel.
  const Eigen::VectorXd scale = pose.colwise().norm().cwiseInverse();
  const Eigen::MatrixXd even = pose * scale.asDiagonal();
  const Eigen::MatrixXd weighed = patches.weight.asDiagonal() * even;
  const Eigen::MatrixXd a = (even.transpose() * weighed).ldlt().solve(weighed.transpose());
  const Eigen::LLT<Eigen::MatrixXd> v(patches.covariance);
  const Eigen::MatrixXd by_v = v.solve(even);
  const Eigen::MatrixXd g = (even.transpose() * by_v).ldlt().solve(by_v.transpose());
  const Eigen::MatrixXd apart = a - g;
  const Vector6 d = apart * patches.residual_mm;
  const Eigen::MatrixXd by_others = apart * others;
  const Matrix6 ordinary = a * patches.covariance * a.transpose();
  const Matrix6 spread = apart * patches.covariance * apart.transpose() + by_others * by_others.transpose();
  const Eigen::LLT<Matrix6> whole(ordinary);
  Disagreement out;
  add_rest(patches, v, &out);
  if (whole.info() != Eigen::Success) return out;
  const Matrix6 half = whole.matrixL().solve(spread);
  const Matrix6 share = whole.matrixL().solve(Matrix6(half.transpose()));
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(0.5 * (share + share.transpose()));
  const Vector6 along = solver.eigenvectors().transpose() * whole.matrixL().solve(d);
  for (int k = 0; k < 6; ++k) {
    if (!(solver.eigenvalues()[k] > kTells)) continue;
    out.chi2 += along[k] * along[k] / solver.eigenvalues()[k];
    ++out.freedom;
  }
  return out;
}

}  // namespace gnathion
