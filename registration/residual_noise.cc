#include "registration/residual_noise.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <tuple>

namespace gnathion {
namespace {

constexpr std::size_t kNoiseSamples = 320;  // Cholesky of this size is a few milliseconds
constexpr std::size_t kMaxCells = 1200;

struct NoiseData {
  Eigen::VectorXd residuals;
  Eigen::MatrixXd jacobian;   // N×6
  Eigen::MatrixXd distance2;  // N×N
  Eigen::MatrixXd cosine;     // N×N, of the normals
};

NoiseData gather(const std::vector<PlanePair>& pairs, const Rigid3& x) {
  std::vector<const PlanePair*> used;
  for (const PlanePair& p : pairs) {
    if (p.weight > 0.0) used.push_back(&p);
  }
  const std::size_t n = std::min(kNoiseSamples, used.size());
  NoiseData data;
  data.residuals.resize(static_cast<long>(n));
  data.jacobian.resize(static_cast<long>(n), 6);
  data.distance2.resize(static_cast<long>(n), static_cast<long>(n));
  data.cosine.resize(static_cast<long>(n), static_cast<long>(n));
  std::vector<const PlanePair*> chosen;
  for (std::size_t i = 0; i < n; ++i) chosen.push_back(used[i * used.size() / n]);
  for (std::size_t i = 0; i < n; ++i) {
    const auto row = static_cast<long>(i);
    data.residuals[row] = chosen[i]->residual_mm(x);
    data.jacobian.row(row) = chosen[i]->jacobian(x).transpose();
    for (std::size_t k = 0; k < n; ++k) {
      data.distance2(row, static_cast<long>(k)) = (chosen[i]->target_mm - chosen[k]->target_mm).squaredNorm();
      data.cosine(row, static_cast<long>(k)) = chosen[i]->normal.dot(chosen[k]->normal);
    }
  }
  // Scaled columns keep the 6×6 of the restricted likelihood well conditioned.
  for (int k = 0; k < 6; ++k) data.jacobian.col(k) /= std::max(1e-9, data.jacobian.col(k).norm());
  return data;
}

struct NoiseModel {
  double length_mm = 1.0, share = 0.0;  // share of the variance that is correlated
  bool vector_field = false;
  double log_likelihood = -std::numeric_limits<double>::infinity();
  double variance = 0.0;
};

/// Restricted log-likelihood with the overall variance profiled out.
void evaluate(const NoiseData& data, NoiseModel& m) {
  const long n = data.residuals.size();
  Eigen::MatrixXd v = (-data.distance2 / (2.0 * m.length_mm * m.length_mm)).array().exp().matrix();
  if (m.vector_field) v.array() *= data.cosine.array();
  v *= m.share;
  v.diagonal().array() += 1.0 - m.share;
  const Eigen::LLT<Eigen::MatrixXd> llt(v);
  if (llt.info() != Eigen::Success) return;
  const Eigen::VectorXd r = llt.matrixL().solve(data.residuals);
  const Eigen::MatrixXd j = llt.matrixL().solve(data.jacobian);
  Matrix6 h = j.transpose() * j;
  h.diagonal().array() += 1e-12 * h.diagonal().maxCoeff();
  const Eigen::LLT<Matrix6> small(h);
  if (small.info() != Eigen::Success) return;
  const Vector6 g = j.transpose() * r;
  const double sum = r.squaredNorm() - g.dot(small.solve(g));
  const auto freedom = static_cast<double>(n - 6);
  m.variance = std::max(sum, 1e-18) / freedom;
  const double log_det_v = 2.0 * Eigen::MatrixXd(llt.matrixL()).diagonal().array().log().sum();
  const double log_det_h = 2.0 * Matrix6(small.matrixL()).diagonal().array().log().sum();
  m.log_likelihood = -0.5 * (freedom * std::log(m.variance) + log_det_v + log_det_h);
}

std::vector<NoiseModel> evaluated(const NoiseData& data) {
  std::vector<NoiseModel> models{{1.0, 0.0, false}};
  for (const bool vector_field : {false, true}) {
    for (const double length : {2.0, 3.5, 6.0, 10.0, 16.0}) {
      for (const double share : {0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95}) {
        models.push_back({length, share, vector_field});
      }
    }
  }
  tbb::parallel_for(std::size_t{0}, models.size(), [&](std::size_t i) { evaluate(data, models[i]); });
  return models;
}

}  // namespace

double ResidualNoise::white_sigma_mm() const {
  double sum = 0.0;
  for (const Model& m : models) sum += m.probability * m.white_sigma_mm * m.white_sigma_mm;
  return std::sqrt(sum);
}

double ResidualNoise::correlated_sigma_mm() const {
  double sum = 0.0;
  for (const Model& m : models) sum += m.probability * m.correlated_sigma_mm * m.correlated_sigma_mm;
  return std::sqrt(sum);
}

double ResidualNoise::length_mm() const {
  double sum = 0.0, total = 0.0;
  for (const Model& m : models) {
    const double weight = m.probability * m.correlated_sigma_mm * m.correlated_sigma_mm;
    sum += weight * m.length_mm;
    total += weight;
  }
  return total > 0.0 ? sum / total : 0.0;
}

ResidualNoise estimate_noise(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source) {
  const NoiseData data = gather(pairs, target_from_source);
  ResidualNoise noise;
  if (data.residuals.size() < 20) {
    // Too few to tell: as if one patch, all correlated.
    noise.models.push_back({1.0, 0.0, weighted_rms_mm(pairs, target_from_source), 10.0, false});
    return noise;
  }
  const std::vector<NoiseModel> models = evaluated(data);
  double best = -std::numeric_limits<double>::infinity(), total = 0.0;
  for (const NoiseModel& m : models) best = std::max(best, m.log_likelihood);
  for (const NoiseModel& m : models) {
    const double likelihood = std::exp(m.log_likelihood - best);
    if (!(likelihood > 0.03)) continue;
    total += likelihood;
    noise.models.push_back({likelihood, std::sqrt(m.variance * (1.0 - m.share)),
                            std::sqrt(m.variance * m.share), m.length_mm, m.vector_field});
  }
  for (ResidualNoise::Model& m : noise.models) m.probability /= total;
  return noise;
}

namespace {

using Score = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 8, 1>;
using ScoreByAxis = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::ColMajor, 8, 3>;

/// The scores of a patch much smaller than ℓ, where the correlated noise is one number.
struct Cell {
  Vector3 sum_mm = Vector3::Zero();
  double count = 0.0;
  Score score;
  ScoreByAxis by_axis;
};

std::vector<Cell> cells_of(const std::vector<PlanePair>& pairs, const ScoreRows& rows, double size_mm) {
  for (;; size_mm *= 1.3) {
    std::map<std::tuple<long, long, long>, Cell> cells;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const PlanePair& p = pairs[i];
      if (!(p.weight > 0.0)) continue;
      const Vector3 at = (p.target_mm / size_mm).array().floor();
      const auto [it, fresh] =
          cells.try_emplace({std::lround(at.x()), std::lround(at.y()), std::lround(at.z())});
      Cell& cell = it->second;
      if (fresh) {
        cell.score = Score::Zero(rows.rows());
        cell.by_axis = ScoreByAxis::Zero(rows.rows(), 3);
      }
      const Score j = p.weight * rows.col(static_cast<long>(i));
      cell.sum_mm += p.target_mm;
      cell.count += 1.0;
      cell.score += j;
      cell.by_axis += j * p.normal.transpose();
    }
    if (cells.size() > kMaxCells) continue;
    std::vector<Cell> out;
    for (const auto& [key, cell] : cells) out.push_back(cell);
    return out;
  }
}

/// Of unit noise with range ℓ.
Eigen::MatrixXd correlated_score(const std::vector<Cell>& cells, long unknowns, double length_mm,
                                 bool vector_field) {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(unknowns, unknowns);
  for (const Cell& a : cells) {
    const Vector3 at = a.sum_mm / a.count;
    Score score = Score::Zero(unknowns);
    ScoreByAxis by_axis = ScoreByAxis::Zero(unknowns, 3);
    for (const Cell& b : cells) {
      const double u = (at - b.sum_mm / b.count).squaredNorm() / (2.0 * length_mm * length_mm);
      if (u > 9.0) continue;
      const double k = std::exp(-u);
      if (vector_field) {
        by_axis += k * b.by_axis;
      } else {
        score += k * b.score;
      }
    }
    if (vector_field) {
      sum += a.by_axis * by_axis.transpose();
    } else {
      sum += a.score * score.transpose();
    }
  }
  return 0.5 * (sum + sum.transpose());
}

}  // namespace

Eigen::MatrixXd score_covariance(const std::vector<PlanePair>& pairs, const ScoreRows& rows,
                                 const ResidualNoise& noise) {
  const long n = rows.rows();
  Eigen::MatrixXd white = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Score j = pairs[i].weight * rows.col(static_cast<long>(i));
    white += j * j.transpose();
  }
  // One correlated part for each range and kind, with the variance that all models together give it.
  std::map<std::pair<double, bool>, double> variances;
  Eigen::MatrixXd total = Eigen::MatrixXd::Zero(n, n);
  for (const ResidualNoise::Model& m : noise.models) {
    total += m.probability * m.white_sigma_mm * m.white_sigma_mm * white;
    if (m.correlated_sigma_mm > 0.0) {
      variances[{m.length_mm, m.vector_field}] +=
          m.probability * m.correlated_sigma_mm * m.correlated_sigma_mm;
    }
  }
  const std::vector<std::pair<std::pair<double, bool>, double>> parts(variances.begin(), variances.end());
  std::vector<Eigen::MatrixXd> sums(parts.size());
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t i) {
    const auto& [length_mm, vector_field] = parts[i].first;
    sums[i] = parts[i].second *
              correlated_score(cells_of(pairs, rows, length_mm / 3.0), n, length_mm, vector_field);
  });
  for (const Eigen::MatrixXd& s : sums) total += s;
  return total;
}

Matrix6 score_covariance(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                         const ResidualNoise& noise) {
  ScoreRows rows(6, static_cast<long>(pairs.size()));
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    rows.col(static_cast<long>(i)) = pairs[i].jacobian(target_from_source);
  }
  return score_covariance(pairs, rows, noise);
}

Vector6 source_scale_score(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                           const Vector3& centre_mm) {
  Vector6 score = Vector6::Zero();
  for (const PlanePair& p : pairs) {
    const double change = p.normal.dot(target_from_source.rotation * (p.source_mm - centre_mm));
    score += p.weight * change * p.jacobian(target_from_source);
  }
  return score;
}

Conditioning conditioning(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source,
                          const Matrix6& covariance) {
  Conditioning result;
  Vector3 centre = Vector3::Zero();
  double total = 0.0, radius2 = 0.0;
  for (const PlanePair& p : pairs) {
    centre += p.weight * p.target_mm;
    total += p.weight;
  }
  if (!(total > 0.0)) return result;
  centre /= total;
  for (const PlanePair& p : pairs) radius2 += p.weight * (p.target_mm - centre).squaredNorm();
  const double radius = std::max(1.0, std::sqrt(radius2 / total));

  const Rigid3 to_centre = Rigid3::from_translation(-centre);
  Matrix6 scale = Matrix6::Identity();  // radians to millimetres at the cloud's radius
  scale.topLeftCorner<3, 3>() *= radius;
  const Matrix6 about = scale * adjoint(to_centre);
  const Matrix6 local_covariance = about * covariance * about.transpose();
  const Matrix6 back = about.inverse();
  const Matrix6 local_information = back.transpose() * information(pairs, target_from_source) * back;

  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(local_information);
  const Vector6 strength = solver.eigenvalues();
  result.condition = strength[0] > 0.0 ? strength[5] / strength[0] : std::numeric_limits<double>::infinity();
  for (int k = 0; k < 6; ++k) {
    const Vector6 direction = solver.eigenvectors().col(k);
    const double sigma_mm = std::sqrt(direction.dot(local_covariance * direction));
    const bool relatively_weak = strength[k] * 50.0 < strength[5] && sigma_mm > 0.02;
    if (!relatively_weak && sigma_mm < 0.1) continue;
    const bool turning = direction.head<3>().norm() > direction.tail<3>().norm();
    Vector3 axis = turning ? direction.head<3>().normalized() : direction.tail<3>().normalized();
    long largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    if (axis[largest] < 0.0) axis = -axis;
    constexpr double kDeg = 57.29577951308232;
    result.weak.push_back(
        turning
            ? fmt::format(
                  "rotation about axis ({:.2f} {:.2f} {:.2f}) through the centroid ({:.1f} {:.1f} {:.1f}) "
                  "mm is weak: {:.2f} deg",
                  axis.x(), axis.y(), axis.z(), centre.x(), centre.y(), centre.z(), sigma_mm / radius * kDeg)
            : fmt::format("translation along ({:.2f} {:.2f} {:.2f}) is weak: {:.3f} mm", axis.x(), axis.y(),
                          axis.z(), sigma_mm));
  }
  return result;
}

double weighted_rms_mm(const std::vector<PlanePair>& pairs, const Rigid3& target_from_source) {
  double sum = 0.0, total = 0.0;
  for (const PlanePair& p : pairs) {
    const double r = p.residual_mm(target_from_source);
    sum += p.weight * r * r;
    total += p.weight;
  }
  return total > 0.0 ? std::sqrt(sum / total) : 0.0;
}

}  // namespace gnathion
