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

// A Cholesky factor of 300 residuals takes a few milliseconds, and there are some eighty models: a few
// residuals tell which of them are worth more.
constexpr std::size_t kFewResiduals = 120, kManyResiduals = 320, kPooledResiduals = 800;
constexpr double kWorthMore = 8.0;  // log-likelihood below the best of few
constexpr std::size_t kMaxCells = 1200;

struct NoiseData {
  Eigen::VectorXd residuals;
  Eigen::MatrixXd jacobian;   // N×6
  Eigen::MatrixXd distance2;  // N×N
  Eigen::MatrixXd cosine;     // N×N, of the normals
};

NoiseData gather(const std::vector<PlanePair>& pairs, const Rigid3& x, std::size_t limit) {
  std::vector<const PlanePair*> used;
  for (const PlanePair& p : pairs) {
    if (p.weight > 0.0) used.push_back(&p);
  }
  const std::size_t n = std::min(limit, used.size());
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
  double share = 0.0;  // of the variance that is correlated
  double log_likelihood = 0.0;
  double variance = 0.0;
  // Over all fits: Σ residual sum of squares, Σ degrees of freedom, Σ log determinants.
  double sum = 0.0, freedom = 0.0, log_det = 0.0;
  bool possible = true;
};

/// One fit's part of the restricted likelihood for a correlation matrix of unit variance.
void add_fit(const NoiseData& data, const Eigen::MatrixXd& correlation, NoiseModel& m) {
  Eigen::MatrixXd v = m.share * correlation;
  v.diagonal().array() += 1.0 - m.share;
  const Eigen::LLT<Eigen::MatrixXd> llt(v);
  if (llt.info() != Eigen::Success) {
    m.possible = false;
    return;
  }
  const Eigen::VectorXd r = llt.matrixL().solve(data.residuals);
  const Eigen::MatrixXd j = llt.matrixL().solve(data.jacobian);
  Matrix6 h = j.transpose() * j;
  h.diagonal().array() += 1e-12 * h.diagonal().maxCoeff();
  const Eigen::LLT<Matrix6> small(h);
  if (small.info() != Eigen::Success) {
    m.possible = false;
    return;
  }
  const Vector6 g = j.transpose() * r;
  m.sum += r.squaredNorm() - g.dot(small.solve(g));
  m.freedom += static_cast<double>(data.residuals.size() - 6);
  m.log_det += 2.0 * Eigen::MatrixXd(llt.matrixL()).diagonal().array().log().sum() +
               2.0 * Matrix6(small.matrixL()).diagonal().array().log().sum();
}

/// The restricted log-likelihood with the overall variance profiled out.
void finish(NoiseModel& m) {
  if (!m.possible) {
    m.log_likelihood = -std::numeric_limits<double>::infinity();
    return;
  }
  m.variance = std::max(m.sum, 1e-18) / m.freedom;
  m.log_likelihood = -0.5 * (m.freedom * std::log(m.variance) + m.log_det);
}

/// Models of one range and kind: they share the correlation matrix, which costs as much as solving with it.
struct ModelGroup {
  double length_mm = 1.0;
  bool vector_field = false;
  std::vector<NoiseModel> models;
};

std::vector<ModelGroup> all_models() {
  std::vector<ModelGroup> groups{{1.0, false, {NoiseModel{}}}};
  for (const bool vector_field : {false, true}) {
    for (const double length : {2.0, 3.5, 6.0, 10.0, 16.0, 26.0}) {
      ModelGroup group{length, vector_field, {}};
      for (const double share : {0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95}) {
        NoiseModel m;
        m.share = share;
        group.models.push_back(m);
      }
      groups.push_back(group);
    }
  }
  return groups;
}

void evaluate(const std::vector<NoiseData>& fits, std::vector<ModelGroup>& groups) {
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t i) {
    ModelGroup& group = groups[i];
    if (group.models.empty()) return;
    for (const NoiseData& data : fits) {
      Eigen::MatrixXd correlation =
          (-data.distance2 / (2.0 * group.length_mm * group.length_mm)).array().exp().matrix();
      if (group.vector_field) correlation.array() *= data.cosine.array();
      for (NoiseModel& m : group.models) add_fit(data, correlation, m);
    }
    for (NoiseModel& m : group.models) finish(m);
  });
}

double best_of(const std::vector<ModelGroup>& groups) {
  double best = -std::numeric_limits<double>::infinity();
  for (const ModelGroup& group : groups)
    for (const NoiseModel& m : group.models) best = std::max(best, m.log_likelihood);
  return best;
}

/// Leaves the models that come within `margin` of the best, as if never evaluated.
void keep_likely(std::vector<ModelGroup>& groups, double margin) {
  const double best = best_of(groups);
  for (ModelGroup& group : groups) {
    std::vector<NoiseModel> kept;
    for (const NoiseModel& m : group.models) {
      if (!(m.log_likelihood > best - margin)) continue;
      NoiseModel fresh;
      fresh.share = m.share;
      kept.push_back(fresh);
    }
    group.models = kept;
  }
}

std::vector<NoiseData> gathered(const std::vector<FitResiduals>& fits, std::size_t limit) {
  std::vector<NoiseData> out;
  for (const FitResiduals& fit : fits) {
    NoiseData data = gather(*fit.pairs, fit.target_from_source, limit);
    if (data.residuals.size() >= 20) out.push_back(std::move(data));
  }
  return out;
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
  return estimate_noise({FitResiduals{&pairs, target_from_source}});
}

ResidualNoise estimate_noise(const std::vector<FitResiduals>& fits) {
  const std::size_t each = kPooledResiduals / std::max<std::size_t>(1, fits.size());
  const std::vector<NoiseData> few = gathered(fits, std::min(kFewResiduals, each));
  ResidualNoise noise;
  if (few.empty()) {
    // Too few to tell: as if one patch, all correlated.
    double largest_mm = 0.0;
    for (const FitResiduals& fit : fits)
      largest_mm = std::max(largest_mm, weighted_rms_mm(*fit.pairs, fit.target_from_source));
    noise.models.push_back({1.0, 0.0, largest_mm, 10.0, false});
    return noise;
  }
  std::vector<ModelGroup> groups = all_models();
  evaluate(few, groups);
  keep_likely(groups, kWorthMore);
  evaluate(gathered(fits, std::clamp(each, kFewResiduals, kManyResiduals)), groups);
  const double best = best_of(groups);
  double total = 0.0;
  for (const ModelGroup& group : groups) {
    for (const NoiseModel& m : group.models) {
      const double likelihood = std::exp(m.log_likelihood - best);
      if (!(likelihood > 0.03)) continue;
      total += likelihood;
      noise.models.push_back({likelihood, std::sqrt(m.variance * (1.0 - m.share)),
                              std::sqrt(m.variance * m.share), group.length_mm, group.vector_field});
    }
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
