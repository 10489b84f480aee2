#include "tracking/body_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "tracking/projection.h"

namespace gnathion {
namespace {

using Jacobian = Eigen::Matrix<double, 8, 6>;

double area(const TagCorners& c) {
  const Eigen::Vector2d a = c[2] - c[0], b = c[3] - c[1];
  return 0.5 * std::abs(a.x() * b.y() - a.y() * b.x());
}

/// Observed minus projected corners, px; false when a corner lies behind the camera.
bool residual_px(const Sighting& s, const Rigid3& rig_from_body, const Vector6& velocity, Vector8* residual,
                 Jacobian* jacobian) {
  for (int k = 0; k < 4; ++k) {
    const Vector3 p_rig = moved_point(rig_from_body * s.tag->corners_in_body_mm[static_cast<std::size_t>(k)],
                                      velocity, s.after_capture_s[k]);
    const Vector3 p = s.camera_from_rig * p_rig;
    if (!(p.z() > 1.0)) return false;
    Eigen::Matrix<double, 2, 3> d;
    residual->segment<2>(2 * k) = s.seen->corners_px[static_cast<std::size_t>(k)] -
                                  project_with_jacobian(s.camera->model, p, jacobian ? &d : nullptr);
    if (jacobian != nullptr) {
      // exp(ξ)·p_rig ≈ p_rig + ω × p_rig + v, then into the camera.
      const Eigen::Matrix<double, 2, 3> in_rig = d * s.camera_from_rig.rotation;
      for (int row = 0; row < 2; ++row) {
        const Vector3 g = in_rig.row(row).transpose();
        jacobian->block<1, 3>(2 * k + row, 0) = p_rig.cross(g).transpose();
        jacobian->block<1, 3>(2 * k + row, 3) = g.transpose();
      }
    }
  }
  return true;
}

/// Weight of a tag whose mean whitened square is `m` where the median tag's is `typical`: falls with 1/m
/// beyond three times that.
double bounded_weight(double m, double typical) {
  const double limit = 3 * std::max(typical, 1.0);
  return m <= limit ? 1.0 : limit / m;
}

}  // namespace

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<Sighting> sightings_of(const Rig& rig, const TaggedBody& body, const RigTags& tags) {
  std::vector<Sighting> sightings;
  for (std::size_t c = 0; c < std::min(tags.size(), rig.cameras.size()); ++c) {
    const Rigid3 camera_from_rig = rig.cameras[c].rig_from_camera.inverse();
    for (const TagObservation& o : tags[c]) {
      const auto known =
          std::find_if(body.tags.begin(), body.tags.end(), [&](const BodyTag& t) { return t.id == o.id; });
      if (known == body.tags.end()) continue;
      const Eigen::LLT<Matrix8> llt(o.covariance_px2);
      if (llt.info() != Eigen::Success) continue;
      Sighting s;
      s.camera = &rig.cameras[c];
      s.camera_index = c;
      s.camera_from_rig = camera_from_rig;
      s.tag = &*known;
      s.seen = &o;
      s.whitener = llt.matrixL().solve(Matrix8::Identity());
      s.area_px2 = area(o.corners_px);
      for (int k = 0; k < 4; ++k)
        s.after_capture_s[k] = after_capture_s(rig.cameras[c], o.corners_px[static_cast<std::size_t>(k)].y());
      sightings.push_back(s);
    }
  }
  return sightings;
}

Vector3 moved_point(const Vector3& p, const Vector6& velocity, double after_s) {
  if (after_s == 0) return p;
  const Vector3 w = velocity.head<3>(), speed = w.cross(p) + velocity.tail<3>();
  return p + after_s * speed + 0.5 * after_s * after_s * w.cross(speed);
}

double rms_px(const Sighting& s, const Rigid3& rig_from_body, const Vector6& velocity) {
  Vector8 r;
  if (!residual_px(s, rig_from_body, velocity, &r, nullptr)) return std::numeric_limits<double>::infinity();
  return std::sqrt(r.squaredNorm() / 8);
}

std::optional<BodyFit> fit_body(std::vector<Sighting>& sightings, const Rigid3& start,
                                const Vector6& velocity, Loss loss, int iterations) {
  const double cauchy_px = loss == Loss::kCauchyWide ? 2.0 : loss == Loss::kCauchy ? 0.6 : 0.0;
  BodyFit fit;
  fit.pose = start;
  std::vector<double> means;
  for (int i = 0;; ++i) {
    Matrix6 n = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    fit.chi2 = fit.squares_px2 = fit.weight = 0;
    fit.tags = 0;
    const double typical = means.empty() ? 0 : median(means);
    means.clear();
    for (Sighting& s : sightings) {
      if (!s.used) continue;
      Vector8 r;
      Jacobian j;
      if (!residual_px(s, fit.pose, velocity, &r, &j)) {
        if (cauchy_px > 0) continue;
        return std::nullopt;
      }
      const Vector8 wr = s.whitener.triangularView<Eigen::Lower>() * r;
      const Jacobian wj = s.whitener.triangularView<Eigen::Lower>() * j;
      const double chi2 = wr.squaredNorm();
      means.push_back(chi2 / 8);
      if (cauchy_px > 0)
        s.weight = 1 / (1 + r.squaredNorm() / (8 * cauchy_px * cauchy_px));
      else
        s.weight = typical > 0 ? bounded_weight(chi2 / 8, typical) : 1;
      n.noalias() += s.weight * (wj.transpose() * wj);
      g.noalias() += s.weight * (wj.transpose() * wr);
      fit.chi2 += s.weight * chi2;
      fit.squares_px2 += r.squaredNorm();
      fit.weight += s.weight;
      ++fit.tags;
    }
    const Eigen::LLT<Matrix6> solver(n);
    if (fit.tags == 0 || solver.info() != Eigen::Success) return std::nullopt;
    fit.information = n;
    const Vector6 step = solver.solve(g);
    if (!step.allFinite()) return std::nullopt;
    fit.pose = exp_se3(step) * fit.pose;
    // A step of a hundredth of what the corners tell: the next would be far smaller. Weights need a round.
    const bool settled = step.dot(g) < 1e-4 && (cauchy_px > 0 || i > 0);
    if (settled || i + 1 >= iterations) {
      fit.chi2 -= step.dot(g);
      return fit;
    }
  }
}

void add_scale_evidence(const std::vector<Sighting>& sightings, const BodyFit& fit, const Vector6& velocity,
                        BodyPose* pose) {
  // One more column c beside the pose's J: with the pose eliminated, information cᵀc − cᵀJ N⁻¹ Jᵀc and
  // gradient cᵀr − cᵀJ N⁻¹ Jᵀr.
  struct Column {
    double cc = 0, cr = 0;
    Vector6 jc = Vector6::Zero();
  };
  std::vector<Column> focal(pose->focal_length.size());
  Column size;
  Vector6 jr = Vector6::Zero();
  const auto add = [](const Vector8& c, const Jacobian& wj, const Vector8& wr, double weight, Column* to) {
    to->cc += weight * c.squaredNorm();
    to->cr += weight * c.dot(wr);
    to->jc += weight * wj.transpose() * c;
  };
  for (const Sighting& s : sightings) {
    if (!s.used) continue;
    Vector8 r, offset, growth;
    Jacobian j;
    if (!residual_px(s, fit.pose, velocity, &r, &j)) return;
    const auto& corners = s.tag->corners_in_body_mm;
    const Vector3 centre = 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
    for (int k = 0; k < 4; ++k) {
      const std::size_t corner = static_cast<std::size_t>(k);
      offset[2 * k] = s.seen->corners_px[corner].x() - s.camera->model.cx_px;
      offset[2 * k + 1] = s.seen->corners_px[corner].y() - s.camera->model.cy_px;
      growth.segment<2>(2 * k) = j.block<2, 3>(2 * k, 3) * (fit.pose.rotation * (corners[corner] - centre));
    }
    const Vector8 wr = s.whitener * r;
    const Jacobian wj = s.whitener * j;
    jr += s.weight * wj.transpose() * wr;
    add(s.whitener * offset, wj, wr, s.weight, &focal[s.camera_index]);
    add(s.whitener * growth, wj, wr, s.weight, &size);
  }
  const Eigen::LLT<Matrix6> solver(fit.information);
  const auto evidence = [&](const Column& c) {
    const Vector6 solved = solver.solve(c.jc);
    return ScaleEvidence{c.cr - solved.dot(jr), std::max(0.0, c.cc - solved.dot(c.jc))};
  };
  for (std::size_t i = 0; i < focal.size(); ++i) pose->focal_length[i] = evidence(focal[i]);
  pose->tag_size = evidence(size);
}

}  // namespace gnathion
