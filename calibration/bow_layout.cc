#include "calibration/bow_layout.h"

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr std::array<std::array<double, 2>, 4> kHalf = {{{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}};

/// Pixel of a point with z > 0, its derivative by the point, and by a relative change of the focal length.
Eigen::Vector2d projected(const CameraModel& c, const Vector3& p, Eigen::Matrix<double, 2, 3>& by_point,
                          Eigen::Vector2d& by_focal) {
  const double iz = 1 / p.z(), x = p.x() * iz, y = p.y() * iz, r2 = x * x + y * y;
  const double radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  const double slope = 2 * (c.k1 + r2 * (2 * c.k2 + 3 * r2 * c.k3));
  const Eigen::Vector2d d = c.distort({x, y});
  const double mixed = x * y * slope + 2 * c.p1 * x + 2 * c.p2 * y;
  Eigen::Matrix2d by_normalised;
  by_normalised << c.fx_px * (radial + x * x * slope + 2 * c.p1 * y + 6 * c.p2 * x), c.fx_px * mixed,
      c.fy_px * mixed, c.fy_px * (radial + y * y * slope + 6 * c.p1 * y + 2 * c.p2 * x);
  Eigen::Matrix<double, 2, 3> normalised_by_point;
  normalised_by_point << iz, 0, -x * iz, 0, iz, -y * iz;
  by_point = by_normalised * normalised_by_point;
  by_focal = {c.fx_px * d.x(), c.fy_px * d.y()};
  return by_focal + Eigen::Vector2d(c.cx_px, c.cy_px);
}

}  // namespace

Vector3 TagLayout::corner_in_tag(std::size_t tag, std::size_t k) const {
  const LayoutTag& t = tags[tag];
  return {kHalf[k][0] * t.nominal_side_mm * std::exp(log_scale + t.log_width),
          kHalf[k][1] * t.nominal_side_mm * std::exp(log_scale + t.log_height), 0};
}

TagLayout layout_of(const TaggedBody& body) {
  TagLayout layout;
  for (const BodyTag& tag : body.tags) {
    const auto& c = tag.corners_in_body_mm;
    LayoutTag t;
    t.id = tag.id;
    const Vector3 along = c[1] - c[0] + c[2] - c[3], up = c[3] - c[0] + c[2] - c[1];
    t.nominal_side_mm =
        0.25 * ((c[1] - c[0]).norm() + (c[2] - c[1]).norm() + (c[3] - c[2]).norm() + (c[0] - c[3]).norm());
    Matrix3& r = t.body_from_tag.rotation;
    // The two directions share what they are off from a right angle.
    const Vector3 x = along.normalized(), y = up.normalized(), sum = (x + y).normalized();
    const Vector3 apart = (x - y).normalized();
    r.col(0) = (sum + apart).normalized();
    r.col(1) = (sum - apart).normalized();
    r.col(2) = r.col(0).cross(r.col(1));
    t.body_from_tag.translation_mm = 0.25 * (c[0] + c[1] + c[2] + c[3]);
    layout.tags.push_back(t);
  }
  return layout;
}

bool evaluate_observation(const RigCamera& camera, const LayoutObservation& o, const TagLayout& layout,
                          const Rigid3& rig_from_body, ObservationTerms& terms) {
  const auto tag = static_cast<std::size_t>(o.tag);
  const Rigid3 camera_from_rig = camera.rig_from_camera.inverse();
  const Rigid3& body_from_tag = layout.tags[tag].body_from_tag;
  const Matrix3 camera_from_body = camera_from_rig.rotation * rig_from_body.rotation;
  const Matrix3 camera_from_tag = camera_from_body * body_from_tag.rotation;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector3 q = layout.corner_in_tag(tag, k), in_body = body_from_tag * q;
    const Vector3 in_rig = rig_from_body * in_body, p = camera_from_rig * in_rig;
    if (p.z() < 1.0) return false;
    Eigen::Matrix<double, 2, 3> by_point;
    Eigen::Vector2d by_focal;
    const Eigen::Vector2d pixel = projected(camera.model, p, by_point, by_focal);
    const int row = 2 * static_cast<int>(k);
    terms.residual.segment<2>(row) = pixel - o.corners_px.segment<2>(row);
    const Eigen::Matrix<double, 2, 3> by_rig = by_point * camera_from_rig.rotation,
                                      by_body = by_point * camera_from_body;
    terms.by_view.block<2, 3>(row, 0) = -by_rig * skew(in_rig);
    terms.by_view.block<2, 3>(row, 3) = by_rig;
    terms.by_tag.block<2, 3>(row, 0) = -by_body * skew(in_body);
    terms.by_tag.block<2, 3>(row, 3) = by_body;
    terms.by_size.block<2, 1>(row, 0) = by_point * camera_from_tag.col(0) * q.x();
    terms.by_size.block<2, 1>(row, 1) = by_point * camera_from_tag.col(1) * q.y();
    terms.by_scale.segment<2>(row) = by_point * camera_from_tag * q;
    terms.by_focal.segment<2>(row) = by_focal;
  }
  const auto w = o.whitening.triangularView<Eigen::Lower>();
  terms.residual = (w * terms.residual).eval();
  terms.by_view = (w * terms.by_view).eval();
  terms.by_tag = (w * terms.by_tag).eval();
  terms.by_size = (w * terms.by_size).eval();
  terms.by_scale = (w * terms.by_scale).eval();
  terms.by_focal = (w * terms.by_focal).eval();
  return true;
}

std::optional<Rigid3> fit_view(const std::vector<RigCamera>& cameras, const TagLayout& layout,
                               const std::vector<const LayoutObservation*>& observations,
                               const Rigid3& start) {
  Rigid3 pose = start;
  double damping = 1e-6, cost = 0;
  const auto sum = [&](const Rigid3& at, Matrix6* h, Vector6* g) -> std::optional<double> {
    double total = 0;
    ObservationTerms terms;
    for (const LayoutObservation* o : observations) {
      if (!evaluate_observation(cameras[static_cast<std::size_t>(o->camera)], *o, layout, at, terms))
        return std::nullopt;
      // Cauchy weights: a start from a layout that is off, or a tag at odds, must not rule.
      const double norm2 = terms.residual.squaredNorm(), weight = 1 / (1 + norm2 / 800);
      total += 800 * std::log1p(norm2 / 800);
      if (h == nullptr) continue;
      *h += weight * terms.by_view.transpose() * terms.by_view;
      *g += weight * terms.by_view.transpose() * terms.residual;
    }
    return total;
  };
  for (int round = 0; round < 50; ++round) {
    Matrix6 h = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    const auto now = sum(pose, &h, &g);
    if (!now) return std::nullopt;
    cost = *now;
    bool better = false;
    for (int attempt = 0; attempt < 12 && !better; ++attempt, damping *= 10) {
      Matrix6 damped = h;
      damped.diagonal() *= 1 + damping;
      const Vector6 step = -damped.ldlt().solve(g);
      const Rigid3 tried = exp_se3(step) * pose;
      const auto there = sum(tried, nullptr, nullptr);
      if (step.norm() < 1e-9) return pose;
      if (!there || *there >= cost) continue;
      pose = tried;
      better = true;
      damping = std::max(1e-9, damping * 1e-3);
      if (cost - *there < 1e-9 * cost) return pose;
    }
    if (!better) return pose;
  }
  return pose;
}

Rigid3 best_rigid_fit(const std::vector<Vector3>& points, const std::vector<Vector3>& targets,
                      const std::vector<double>& weights) {
  Vector3 from = Vector3::Zero(), to = Vector3::Zero();
  double total = 0;
  const auto weight = [&](std::size_t i) { return weights.empty() ? 1.0 : weights[i]; };
  for (std::size_t i = 0; i < points.size(); ++i) {
    from += weight(i) * points[i];
    to += weight(i) * targets[i];
    total += weight(i);
  }
  from /= total;
  to /= total;
  Matrix3 cross = Matrix3::Zero();
  for (std::size_t i = 0; i < points.size(); ++i)
    cross += weight(i) * (targets[i] - to) * (points[i] - from).transpose();
  const Eigen::JacobiSVD<Matrix3> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3 sign = Matrix3::Identity();
  sign(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Matrix3 r = svd.matrixU() * sign * svd.matrixV().transpose();
  return {r, to - r * from};
}

}  // namespace gnathion
