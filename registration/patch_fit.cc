#include "registration/patch_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
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
  double weight = 0.0;
  std::vector<std::uint32_t> samples;
};

/// The axis that a normal is nearest to, with its sign: 0 to 5.
int facing(const Vector3& normal) {
  int axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  return 2 * axis + (normal[axis] < 0.0 ? 1 : 0);
}

std::vector<Patch> gathered(const std::vector<PlanePair>& pairs, double size_mm) {
  for (;; size_mm *= 1.15) {
    std::map<std::array<int, 4>, Patch> patches;
    for (const PlanePair& p : pairs) {
      if (!(p.weight > 0.0)) continue;
      const Eigen::Vector3i at = (p.target_mm / size_mm).array().floor().cast<int>();
      Patch& patch = patches[{at.x(), at.y(), at.z(), facing(p.normal)}];
      patch.sum_mm += p.weight * p.target_mm;
      patch.normals += p.weight * p.normal;
      patch.weight += p.weight;
      patch.samples.push_back(p.sample);
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

/// Mean residuals of the patches, r + J·ξ.
struct PatchModel::Means {
  Eigen::VectorXd residual_mm;  // P
  Eigen::MatrixXd jacobian;     // P×U
  Eigen::VectorXd weight;       // Σ of the pairs' weights, P
};

PatchModel::PatchModel(const std::vector<PlanePair>& pairs, const ResidualNoise& noise) {
  const std::vector<Patch> patches = gathered(pairs, std::max(0.3, kPatchOfRange * noise.length_mm()));
  std::uint32_t samples = 0;
  for (const PlanePair& p : pairs) samples = std::max(samples, p.sample + 1);
  patch_of_sample_.assign(samples, -1);
  for (std::size_t i = 0; i < patches.size(); ++i)
    for (const std::uint32_t sample : patches[i].samples) patch_of_sample_[sample] = static_cast<int>(i);
  covariance_mm2_.compute(covariance_of(patches, noise));
}

PatchModel::Means PatchModel::means(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                                    const Eigen::Ref<const Eigen::MatrixXd>& rows) const {
  const long n = covariance_mm2_.rows();
  Means m{Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Zero(n, rows.rows()), Eigen::VectorXd::Zero(n)};
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const PlanePair& p = pairs[i];
    if (!(p.weight > 0.0) || p.sample >= patch_of_sample_.size()) continue;
    const int patch = patch_of_sample_[p.sample];
    if (patch < 0) continue;
    m.residual_mm[patch] += p.weight * p.residual_mm(target_from_source);
    m.jacobian.row(patch) += p.weight * rows.col(static_cast<long>(i)).transpose();
    m.weight[patch] += p.weight;
  }
  const Eigen::VectorXd by_weight = m.weight.cwiseMax(1e-12).cwiseInverse();
  m.residual_mm.array() *= by_weight.array();
  m.jacobian = by_weight.asDiagonal() * m.jacobian;
  return m;
}

/// Times V^(−1/2).
struct PatchModel::Whitened {
  Eigen::MatrixXd jacobian;
  Eigen::VectorXd residual;
};

/// The residual of a patch without pairs could be anything: as an unknown of its own it is projected out.
PatchModel::Whitened PatchModel::whitened(const Means& m) const {
  std::vector<long> lost;
  for (long i = 0; i < m.weight.size(); ++i)
    if (!(m.weight[i] > 0.0)) lost.push_back(i);
  Whitened w{covariance_mm2_.matrixL().solve(m.jacobian), covariance_mm2_.matrixL().solve(m.residual_mm)};
  if (lost.empty()) return w;
  Eigen::MatrixXd anything = Eigen::MatrixXd::Zero(m.weight.size(), static_cast<long>(lost.size()));
  for (std::size_t k = 0; k < lost.size(); ++k) anything(lost[k], static_cast<long>(k)) = 1.0;
  covariance_mm2_.matrixL().solveInPlace(anything);
  const Eigen::MatrixXd basis = Eigen::HouseholderQR<Eigen::MatrixXd>(anything).householderQ() *
                                Eigen::MatrixXd::Identity(anything.rows(), anything.cols());
  w.jacobian -= basis * (basis.transpose() * w.jacobian);
  w.residual -= basis * (basis.transpose() * w.residual);
  return w;
}

GeneralisedScore PatchModel::score(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                                   const ScoreRows& rows) const {
  const Whitened w = whitened(means(pairs, target_from_source, rows));
  return {w.jacobian.transpose() * w.jacobian, w.jacobian.transpose() * w.residual};
}

GeneralisedScore PatchModel::score_beside(const std::vector<PlanePair>& pairs,
                                          const Rigid3& target_from_source, const ScoreRows& rows,
                                          const Eigen::MatrixXd& beside) const {
  Eigen::MatrixXd all(rows.rows() + beside.rows(), rows.cols());
  all << rows, beside;
  Whitened w = whitened(means(pairs, target_from_source, all));
  const Eigen::MatrixXd known = w.jacobian.leftCols(rows.rows());
  Eigen::MatrixXd free = w.jacobian.rightCols(beside.rows());
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(known);
  free -= known * qr.solve(free);
  return {free.transpose() * free, free.transpose() * w.residual};
}

Eigen::MatrixXd PatchModel::cross(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                                  const ScoreRows& rows, const Eigen::MatrixXd& beside) const {
  Eigen::MatrixXd all(rows.rows() + beside.rows(), rows.cols());
  all << rows, beside;
  const Whitened w = whitened(means(pairs, target_from_source, all));
  return w.jacobian.leftCols(rows.rows()).transpose() * w.jacobian.rightCols(beside.rows());
}

Disagreement PatchModel::disagreement(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                                      const ScoreRows& rows, const Eigen::VectorXd& other_sigmas) const {
  constexpr double kTells = 0.02;  // of the ordinary variance: less is rounding
  // Of the pairs that the model was made of: no patch is without.
  const Means m = means(pairs, target_from_source, rows);
  const auto [j, r] = whitened(m);
  Disagreement out;
  if (j.rows() <= j.cols()) return out;
  // What the generalised fit leaves. Scales of both surfaces together may do what a translation does.
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(j);
  out.rest_chi2 = (r - j * qr.solve(r)).squaredNorm();
  out.rest_freedom = static_cast<int>(j.rows() - qr.rank());
  // ξ = −A·r for the ordinary fit, −G·r for the generalised; columns scaled alike, which χ² does not feel.
  const Eigen::MatrixXd pose = m.jacobian.leftCols<6>();
  const Eigen::MatrixXd others = m.jacobian.rightCols(other_sigmas.size()) * other_sigmas.asDiagonal();
  const Eigen::VectorXd scale = pose.colwise().norm().cwiseInverse();
  const Eigen::MatrixXd even = pose * scale.asDiagonal();
  const Eigen::MatrixXd weighed = m.weight.asDiagonal() * even;
  const Eigen::MatrixXd a = (even.transpose() * weighed).ldlt().solve(weighed.transpose());
  const Eigen::MatrixXd by_v = covariance_mm2_.solve(even);
  const Eigen::MatrixXd g = (even.transpose() * by_v).ldlt().solve(by_v.transpose());
  const Eigen::MatrixXd apart = a - g;
  const Vector6 d = apart * m.residual_mm;
  const auto spread_of = [&](const Eigen::MatrixXd& by_residual) -> Matrix6 {
    const Eigen::MatrixXd by_white = covariance_mm2_.matrixU() * by_residual.transpose();
    return by_white.transpose() * by_white;
  };
  const Eigen::MatrixXd by_others = apart * others;
  const Matrix6 ordinary = spread_of(a), spread = spread_of(apart) + by_others * by_others.transpose();
  const Eigen::LLT<Matrix6> whole(ordinary);
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
