#include "evaluation/discrepancy.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr double kChi2Of3At95 = 7.814728;
constexpr double kNormalAt95 = 1.959964;

/// Symmetric, finite, no negative variance.
bool is_covariance(const Matrix6& m) {
  if (!m.allFinite() || (m - m.transpose()).norm() > 1e-6 * (1.0 + m.norm())) return false;
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(m);
  return solver.eigenvalues().minCoeff() > -1e-9 * (1.0 + m.norm());
}

LandmarkShift shift_of(const Landmark& landmark, const Uncertain<Motion<Dental>>& motion,
                       const ArchFrame& arch) {
  LandmarkShift s;
  s.landmark = landmark;
  const Vector3 moved = motion.value * landmark.at_mm;
  s.displacement_mm = moved - landmark.at_mm;
  s.length_mm = s.displacement_mm.norm();
  const Matrix3 cov = point_covariance(motion.covariance, moved);
  const Vector3 axes[3] = {arch.left, arch.anterior, arch.up};
  for (int k = 0; k < 3; ++k) {
    s.in_arch_mm[k] = axes[k].dot(s.displacement_mm);
    s.in_arch95_mm[k] = kNormalAt95 * std::sqrt(std::max(0.0, axes[k].dot(cov * axes[k])));
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3> ellipsoid(cov);
  s.bound95_mm = std::sqrt(kChi2Of3At95 * std::max(0.0, ellipsoid.eigenvalues().maxCoeff()));
  return s;
}

}  // namespace

double chi_square_upper_tail(double x, int even_degrees_of_freedom) {
  double term = std::exp(-0.5 * x), sum = 0.0;
  for (int k = 0; k < even_degrees_of_freedom / 2; ++k) {
    sum += term;
    term *= 0.5 * x / (k + 1);
  }
  return std::min(1.0, sum);
}

RepeatedPose mean_pose(const std::vector<MandiblePose>& recordings, const Vector3& about_mm) {
  RepeatedPose r;
  r.recordings = recordings.size();
  if (recordings.empty()) return r;
  const auto n = static_cast<double>(recordings.size());
  Rigid3 mean = recordings.front().value.rigid;
  for (int i = 0; i < 30; ++i) {
    Vector6 step = Vector6::Zero();
    for (const MandiblePose& p : recordings) step += difference(p.value.rigid, mean) / n;
    mean = exp_se3(step) * mean;
    if (step.norm() < 1e-14) break;
  }
  r.mean.value = Motion<Dental>(mean);
  Matrix6 claimed = Matrix6::Zero(), scatter = Matrix6::Zero();
  const Matrix6 at_point = adjoint(Rigid3::from_translation(-(mean * about_mm)));
  for (const MandiblePose& p : recordings) {
    claimed += p.covariance / (n * n);
    const Vector6 d = difference(p.value.rigid, mean);
    if (recordings.size() > 1) scatter += d * d.transpose() / (n * (n - 1.0));
    const Vector6 told = at_point * d;
    if (recordings.size() > 1) {
      r.scatter_deg += std::pow(told.head<3>().norm() * 180.0 / M_PI, 2) / (n - 1.0);
      r.scatter_mm += std::pow(told.tail<3>().norm(), 2) / (n - 1.0);
    }
  }
  r.scatter_deg = std::sqrt(r.scatter_deg);
  r.scatter_mm = std::sqrt(r.scatter_mm);
  // The larger of the two, by what they say of the point: few recordings give a scatter of low rank, so it is
  // not used alone but raises the claim where it exceeds it.
  const double claimed_mm = std::sqrt(point_covariance(claimed, mean * about_mm).trace());
  const double found_mm = std::sqrt(point_covariance(scatter, mean * about_mm).trace());
  r.mean.covariance = found_mm > claimed_mm ? Matrix6(claimed + scatter) : claimed;
  return r;
}

Result<Discrepancy> find_discrepancy(const std::vector<MandiblePose>& mi, const std::vector<MandiblePose>& cr,
                                     const std::vector<Landmark>& landmarks, const ArchFrame& arch) {
  if (mi.empty() || cr.empty())
    return bad_input("cannot compare", mi.empty() ? "MI" : "CR", "no recording of this position");
  for (const auto* list : {&mi, &cr})
    for (const MandiblePose& p : *list)
      if (!is_covariance(p.covariance))
        return bad_input("cannot compare", list == &mi ? "MI" : "CR", "its covariance is not one");
  Discrepancy d;
  d.mi = mean_pose(mi, arch.origin_mm);
  d.cr = mean_pose(cr, arch.origin_mm);
  const Rigid3 mi_inverse = d.mi.mean.value.rigid.inverse();
  d.cr_from_mi.value = Motion<Dental>(d.cr.mean.value.rigid * mi_inverse);
  d.cr_from_mi.covariance =
      composed_covariance(d.cr.mean.covariance, d.cr.mean.value.rigid,
                          inverse_covariance(d.mi.mean.covariance, d.mi.mean.value.rigid));

  const Vector6 xi = log_se3(d.cr_from_mi.value.rigid);
  d.alpha_deg = xi.head<3>().norm() * 180.0 / M_PI;
  const Matrix3 turn = d.cr_from_mi.covariance.topLeftCorner<3, 3>();
  const Vector3 axis = xi.head<3>().norm() > 1e-12 ? Vector3(xi.head<3>().normalized()) : Vector3(arch.left);
  d.alpha95_deg = kNormalAt95 * std::sqrt(std::max(0.0, axis.dot(turn * axis))) * 180.0 / M_PI;
  for (const Landmark& l : landmarks) d.landmarks.push_back(shift_of(l, d.cr_from_mi, arch));
  // A covariance that leaves a direction without error is taken as a hair's breadth there.
  const Matrix6 cov = d.cr_from_mi.covariance + 1e-16 * Matrix6::Identity();
  d.chi2 = xi.dot(cov.ldlt().solve(xi));
  d.p_value = chi_square_upper_tail(d.chi2, 6);
  return d;
}

}  // namespace gnathion
