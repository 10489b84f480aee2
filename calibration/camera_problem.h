// Cameras, a rig and a board in many poses as one least-squares problem. Internal to the calibration of
// cameras.
#pragma once

#include <optional>
#include <vector>

#include "calibration/camera_residual.h"

namespace gnathion::camera_problem {

using Matrix2 = Eigen::Matrix2d;

struct Corner {
  int point = 0;
  Vector2 px;
  Matrix2 covariance_px2;  ///< the detector's
  bool used = true;        ///< false: an outlier
};

/// The board in one camera at one instant.
struct View {
  std::size_t camera = 0, instant = 0;
  std::vector<Corner> corners;
};

/// What is estimated. Shared parameters are ordered: nine intrinsics of each camera, rig_from_camera (6) of
/// each but the first, and the bend where it is free.
struct State {
  std::vector<Vector9> intrinsics;
  std::vector<Rigid3> rig_from_camera;
  std::vector<Rigid3> rig_from_board;  ///< by instant
  Bend bend = Bend::Zero();
  double extra_px = 0;  ///< noise beyond the corners' covariances, per coordinate

  std::size_t cameras() const { return intrinsics.size(); }
};

struct Problem {
  std::vector<BoardPoint> points;
  std::vector<View> views;
  bool free_k3 = true, free_bend = false;

  std::size_t shared_count(const State& state) const;
};

View make_view(const BoardView& view, std::size_t camera, std::size_t instant);

enum class Loss { kCauchy, kHuber };
/// Minimises over everything that is free; false where it does not converge to finite numbers.
bool solve(const Problem& problem, Loss loss, double loss_sigmas, State* state);

/// Measured − predicted of a corner, px; nothing for a point behind the camera.
std::optional<Vector2> residual(const Problem& problem, const State& state, const View& view,
                                const Corner& corner);
/// Squared length of a residual over its standard deviation.
double squared_sigmas(const Corner& corner, const Vector2& residual_px, double extra_px);

/// Gauss and Newton for rig_from_board over `view`'s corners with `select(point)`; the others stay as they
/// are. Returns the RMS of the residuals over all selected corners (√ of the mean of dx² + dy²), or nothing
/// where it fails.
template <class Select>
std::optional<double> fit_pose(const Problem& problem, const State& state, const View& view,
                               const Select& select, Rigid3* rig_from_board);

/// The information that one instant adds to the shared parameters once its board pose is out, and the
/// gradient.
struct Reduced {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
};
/// By instant. Parameters that are held have zero rows.
std::vector<Reduced> reduce(const Problem& problem, const State& state);
/// Inverse of the summed information over the free parameters, times `scale²`; nothing where it is singular.
std::optional<Eigen::MatrixXd> shared_covariance(const std::vector<Reduced>& parts, double scale);

// ---------------------------------------------------------------------------------------------------------------------

template <class Select>
std::optional<double> fit_pose(const Problem& problem, const State& state, const View& view,
                               const Select& select, Rigid3* rig_from_board) {
  double lambda = 1e-6;
  const auto cost_at = [&](const Rigid3& pose, Matrix6* n, Vector6* g, double* sum2, int* count) {
    double cost = 0;
    *sum2 = 0, *count = 0;
    if (n != nullptr) n->setZero(), g->setZero();
    for (const Corner& c : view.corners) {
      if (!select(c.point)) continue;
      Vector2 px;
      PixelDerivatives d;
      if (!project(state.intrinsics[view.camera], state.rig_from_camera[view.camera], pose,
                   problem.points[static_cast<std::size_t>(c.point)], state.bend, &px, &d))
        return std::optional<double>();
      const Vector2 r = c.px - px;
      const double s = std::sqrt(squared_sigmas(c, r, state.extra_px));
      const double weight = s > 4 ? 4 / s : 1;  // Huber
      cost += s > 4 ? 8 * s - 16 : s * s;
      *sum2 += r.squaredNorm();
      ++*count;
      if (n == nullptr) continue;
      const Matrix2 information =
          weight * (c.covariance_px2 + state.extra_px * state.extra_px * Matrix2::Identity()).inverse();
      *n += d.rig_from_board.transpose() * information * d.rig_from_board;
      *g += d.rig_from_board.transpose() * information * r;
    }
    return std::optional<double>(cost);
  };
  double sum2 = 0;
  int count = 0;
  for (int i = 0; i < 50; ++i) {
    Matrix6 n;
    Vector6 g;
    const auto cost = cost_at(*rig_from_board, &n, &g, &sum2, &count);
    if (!cost || count < 4) return std::nullopt;
    bool better = false;
    Vector6 step = Vector6::Zero();
    for (int t = 0; t < 10 && !better; ++t, lambda *= 10) {
      Matrix6 damped = n;
      damped.diagonal() *= 1 + lambda;
      step = damped.ldlt().solve(g);
      if (!step.allFinite()) return std::nullopt;
      const Rigid3 next = exp_se3(step) * *rig_from_board;
      double there2 = 0;
      const auto there = cost_at(next, nullptr, nullptr, &there2, &count);
      better = there && *there <= *cost;
      if (!better) continue;
      *rig_from_board = next;
      sum2 = there2;
      lambda = std::max(lambda * 1e-3, 1e-10);
      if (*cost - *there < 1e-10 * *cost + 1e-14) return std::sqrt(sum2 / count);
    }
    if (!better) break;
  }
  return std::sqrt(sum2 / std::max(count, 1));
}

}  // namespace gnathion::camera_problem
