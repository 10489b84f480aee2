#include "calibration/camera_start.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

namespace gnathion::camera_problem {
namespace {

/// `image` from the board's plane by the direct linear transform, both sides normalised (Hartley 1997).
std::optional<Matrix3> homography(const std::vector<Vector2>& plane, const std::vector<Vector2>& image) {
  if (plane.size() < 4) return std::nullopt;
  const auto normalising = [](const std::vector<Vector2>& points) -> Matrix3 {
    Vector2 mean = Vector2::Zero();
    for (const Vector2& p : points) mean += p / static_cast<double>(points.size());
    double spread = 0;
    for (const Vector2& p : points) spread += (p - mean).norm() / static_cast<double>(points.size());
    const double s = std::sqrt(2.0) / std::max(spread, 1e-12);
    Matrix3 t;
    t << s, 0, -s * mean.x(), 0, s, -s * mean.y(), 0, 0, 1;
    return t;
  };
  const Matrix3 tp = normalising(plane), ti = normalising(image);
  Eigen::Matrix<double, Eigen::Dynamic, 9> a(2 * plane.size(), 9);
  for (std::size_t i = 0; i < plane.size(); ++i) {
    const Vector3 p = tp * plane[i].homogeneous(), q = ti * image[i].homogeneous();
    const auto row = static_cast<Eigen::Index>(2 * i);
    a.row(row) << p.transpose(), 0, 0, 0, -q.x() * p.transpose();
    a.row(row + 1) << 0, 0, 0, p.transpose(), -q.y() * p.transpose();
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(a, Eigen::ComputeFullV);
  if (!(svd.singularValues()(7) > 1e-9 * svd.singularValues()(0))) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> h = svd.matrixV().col(8);
  Matrix3 m;
  m << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8];
  return Matrix3(ti.inverse() * m * tp);
}

void coordinates(const std::vector<BoardPoint>& points, const View& view, std::vector<Vector2>* plane,
                 std::vector<Vector2>* image) {
  for (const Corner& c : view.corners) {
    plane->push_back(points[static_cast<std::size_t>(c.point)].flat_mm.head<2>());
    image->push_back(c.px);
  }
}

/// Columns of the homography K·[r1 r2 t] from coordinates about the principal point (Zhang 2000,
/// section 3.1).
std::optional<Rigid3> pose_from(Matrix3 h, double f) {
  h.topRows<2>() /= f;
  const double scale = 2 / (h.col(0).norm() + h.col(1).norm());
  h *= h(2, 2) < 0 ? -scale : scale;
  Matrix3 r;
  r << h.col(0), h.col(1), h.col(0).cross(h.col(1));
  const Eigen::JacobiSVD<Matrix3> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Rigid3 pose{svd.matrixU() * svd.matrixV().transpose(), h.col(2)};
  if (pose.rotation.determinant() < 0 || !pose.translation_mm.allFinite()) return std::nullopt;
  return pose;
}

/// f of square pixels from r1·r2 = 0 and |r1| = |r2| over all views; nothing where they leave it open.
std::optional<double> focal_length(const std::vector<Matrix3>& centred) {
  double qq = 0, qz = 0;
  for (Matrix3 h : centred) {
    h /= std::sqrt(h.col(0).norm() * h.col(1).norm());
    const double q1 = h(0, 0) * h(0, 1) + h(1, 0) * h(1, 1), z1 = h(2, 0) * h(2, 1);
    const double q2 = h.col(0).head<2>().squaredNorm() - h.col(1).head<2>().squaredNorm();
    const double z2 = h(2, 0) * h(2, 0) - h(2, 1) * h(2, 1);
    qq += q1 * q1 + q2 * q2;
    qz += q1 * z1 + q2 * z2;
  }
  const double inverse2 = -qz / qq;
  if (!(inverse2 > 0) || !std::isfinite(inverse2)) return std::nullopt;
  return 1 / std::sqrt(inverse2);
}

double robust_cost(const Problem& problem, const State& state) {
  double cost = 0;
  for (const View& v : problem.views)
    for (const Corner& c : v.corners) {
      const auto r = residual(problem, state, v, c);
      cost += r ? std::log1p(r->squaredNorm()) : 20;
    }
  return cost;
}

Rigid3 tilted_the_other_way(const Rigid3& pose, const Vector3& centre_on_board) {
  const Vector3 centre = pose * centre_on_board;
  const Vector3 sight = centre.normalized(), normal = pose.rotation.col(2);
  const Vector3 mirrored = 2 * sight.dot(normal) * sight - normal;
  const Matrix3 turn = Eigen::Quaterniond::FromTwoVectors(normal, mirrored).toRotationMatrix();
  Rigid3 other{turn * pose.rotation, Vector3::Zero()};
  other.translation_mm = centre - other.rotation * centre_on_board;
  return other;
}

/// Poses for a focal length, then a short solution of everything.
std::optional<State> attempt(const std::vector<BoardPoint>& points, const std::vector<View>& views, double f,
                             double cx, double cy, bool free_k3) {
  Problem problem{points, {}, free_k3, false};
  State state;
  Vector9 k = Vector9::Zero();
  k.head<4>() << f, f, cx, cy;
  state.intrinsics = {k};
  state.rig_from_camera = {Rigid3::identity()};
  state.extra_px = 1;
  for (View v : views) {
    v.camera = 0;
    const auto pose = start_pose(problem, state, v);
    if (!pose) return std::nullopt;
    v.instant = state.rig_from_board.size();
    state.rig_from_board.push_back(*pose);
    problem.views.push_back(v);
  }
  // The radial terms first: with all of them free a poor start may run off.
  problem.free_k3 = false;
  if (!solve(problem, Loss::kCauchy, 3.0, &state)) return std::nullopt;
  const double f_after = state.intrinsics[0].head<2>().minCoeff();
  if (!(f_after > 0.05 * f) || !(state.intrinsics[0].head<2>().maxCoeff() < 100 * f)) return std::nullopt;
  return state;
}

}  // namespace

std::optional<Rigid3> start_pose(const Problem& problem, const State& state, const View& view) {
  const Vector9& k = state.intrinsics[view.camera];
  const CameraModel model = model_of(k, 0, 0);
  std::vector<Vector2> plane, image;
  coordinates(problem.points, view, &plane, &image);
  for (Vector2& p : image) p = model.undistorted(p);
  const auto h = homography(plane, image);
  if (!h) return std::nullopt;
  const auto first = pose_from(*h, 1);
  if (!first) return std::nullopt;
  Vector3 centre = Vector3::Zero();
  for (const Vector2& p : plane) centre.head<2>() += p / static_cast<double>(plane.size());
  std::optional<Rigid3> best;
  double best_rms = std::numeric_limits<double>::infinity();
  const auto all = [](int) { return true; };
  for (Rigid3 start : {*first, tilted_the_other_way(*first, centre)}) {
    const Rigid3& camera = state.rig_from_camera[view.camera];
    Rigid3 pose = camera * start;
    const auto rms = fit_pose(problem, state, view, all, &pose);
    if (rms && *rms < best_rms) {
      best_rms = *rms;
      best = pose;
    }
  }
  return best;
}

std::optional<State> start_camera(const std::vector<BoardPoint>& points, const std::vector<View>& views,
                                  int width_px, int height_px, bool free_k3) {
  constexpr std::size_t kTrialViews = 12;
  const double cx = 0.5 * (width_px - 1), cy = 0.5 * (height_px - 1);
  std::vector<View> trial;
  const std::size_t step = std::max<std::size_t>(1, views.size() / kTrialViews);
  for (std::size_t i = 0; i < views.size() && trial.size() < kTrialViews; i += step)
    trial.push_back(views[i]);
  std::vector<Matrix3> centred;
  for (const View& v : views) {
    std::vector<Vector2> plane, image;
    coordinates(points, v, &plane, &image);
    for (Vector2& p : image) p -= Vector2(cx, cy);
    if (const auto h = homography(plane, image)) centred.push_back(*h);
  }
  std::vector<double> focal_lengths;
  if (const auto f = focal_length(centred))
    focal_lengths.push_back(std::clamp(*f, 0.2 * width_px, 20.0 * width_px));
  for (const double share : {0.6, 1.0, 1.7, 3.0}) focal_lengths.push_back(share * width_px);
  std::optional<State> best;
  double best_cost = std::numeric_limits<double>::infinity();
  for (const double f : focal_lengths) {
    const auto state = attempt(points, trial, f, cx, cy, free_k3);
    if (!state) continue;
    Problem problem{points, trial, false, false};
    for (std::size_t i = 0; i < trial.size(); ++i) problem.views[i].camera = 0, problem.views[i].instant = i;
    const double cost = robust_cost(problem, *state);
    if (cost < best_cost) {
      best_cost = cost;
      best = state;
    }
  }
  if (!best) return std::nullopt;
  // The views that were not tried.
  Problem problem{points, {}, free_k3, false};
  best->rig_from_board.clear();
  for (View v : views) {
    v.camera = 0;
    const auto pose = start_pose(problem, *best, v);
    best->rig_from_board.push_back(pose ? *pose : Rigid3::from_translation(Vector3(0, 0, -1)));
  }
  return best;
}

}  // namespace gnathion::camera_problem
