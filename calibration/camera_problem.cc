#include "calibration/camera_problem.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "calibration/se3_manifold.h"

namespace gnathion::camera_problem {
namespace {

Matrix2 whitening(const Corner& corner, double extra_px) {
  const Matrix2 covariance = corner.covariance_px2 + extra_px * extra_px * Matrix2::Identity();
  return covariance.llt().matrixL().solve(Matrix2::Identity());
}

/// Whitened residual (measured − predicted) of one corner over intrinsics, rig_from_camera, rig_from_board,
/// bend.
class CornerCost final : public ceres::SizedCostFunction<2, kIntrinsics, 7, 7, kBend> {
 public:
  CornerCost(const BoardPoint& point, const Corner& corner, double extra_px)
      : point_(point), px_(corner.px), whiten_(whitening(corner, extra_px)) {}

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Vector9 intrinsics = Eigen::Map<const Vector9>(x[0]);
    const Bend bend = Eigen::Map<const Bend>(x[3]);
    Vector2 px;
    PixelDerivatives d;
    if (!project(intrinsics, rigid_from_parameters(x[1]), rigid_from_parameters(x[2]), point_, bend, &px,
                 jacobians ? &d : nullptr))
      return false;
    Eigen::Map<Vector2> r(residuals);
    r = whiten_ * (px_ - px);
    if (jacobians == nullptr) return true;
    const auto put = [&](int block, const auto& derivative) {
      using Matrix =
          Eigen::Matrix<double, 2, std::decay_t<decltype(derivative)>::ColsAtCompileTime, Eigen::RowMajor>;
      if (jacobians[block] != nullptr) {
        Eigen::Map<Matrix> out(jacobians[block]);
        out = -whiten_ * derivative;
      }
    };
    put(0, d.intrinsics);
    put(1, d.rig_from_camera * minus(x[1]));
    put(2, d.rig_from_board * minus(x[2]));
    put(3, d.bend);
    return true;
  }

 private:
  /// Takes tangent derivatives to those by the seven numbers, which the manifold takes back again.
  static Eigen::Matrix<double, 6, 7> minus(const double* x) {
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> m;
    Se3Manifold().MinusJacobian(x, m.data());
    return m;
  }
  BoardPoint point_;
  Vector2 px_;
  Matrix2 whiten_;
};

}  // namespace

std::size_t Problem::shared_count(const State& state) const {
  return kIntrinsics * state.cameras() + 6 * (state.cameras() - 1) + (free_bend ? kBend : 0);
}

View make_view(const BoardView& view, std::size_t camera, std::size_t instant) {
  View v{camera, instant, {}};
  for (const BoardCorner& c : view.corners) v.corners.push_back({c.id, c.px, c.covariance_px2, true});
  return v;
}

bool solve(const Problem& problem, Loss loss, double loss_sigmas, State* state) {
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  const ceres::CauchyLoss cauchy(loss_sigmas);
  const ceres::HuberLoss huber(loss_sigmas);
  Se3Manifold se3;
  ceres::SubsetManifold without_k3(kIntrinsics, {kIntrinsics - 1});
  ceres::Problem ceres_problem(problem_options);
  std::vector<PoseParameters> cameras, boards;
  for (const Rigid3& x : state->rig_from_camera) cameras.push_back(pose_parameters(x));
  for (const Rigid3& x : state->rig_from_board) boards.push_back(pose_parameters(x));
  ceres::LossFunction* function =
      loss == Loss::kCauchy ? static_cast<ceres::LossFunction*>(const_cast<ceres::CauchyLoss*>(&cauchy))
                            : const_cast<ceres::HuberLoss*>(&huber);
  std::vector<char> camera_there(cameras.size(), 0), board_there(boards.size(), 0);
  for (const View& v : problem.views)
    for (const Corner& c : v.corners) {
      if (!c.used) continue;
      ceres_problem.AddResidualBlock(
          new CornerCost(problem.points[static_cast<std::size_t>(c.point)], c, state->extra_px), function,
          state->intrinsics[v.camera].data(), cameras[v.camera].data(), boards[v.instant].data(),
          state->bend.data());
      camera_there[v.camera] = board_there[v.instant] = 1;
    }
  if (ceres_problem.NumResidualBlocks() == 0) return false;
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (std::size_t i = 0; i < boards.size(); ++i) {
    if (!board_there[i]) continue;
    ceres_problem.SetManifold(boards[i].data(), &se3);
    ordering->AddElementToGroup(boards[i].data(), 0);
  }
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (!camera_there[i]) continue;
    ceres_problem.SetManifold(cameras[i].data(), &se3);
    if (i == 0) ceres_problem.SetParameterBlockConstant(cameras[i].data());
    if (!problem.free_k3) ceres_problem.SetManifold(state->intrinsics[i].data(), &without_k3);
    ordering->AddElementToGroup(cameras[i].data(), 1);
    ordering->AddElementToGroup(state->intrinsics[i].data(), 1);
  }
  if (!problem.free_bend) ceres_problem.SetParameterBlockConstant(state->bend.data());
  ordering->AddElementToGroup(state->bend.data(), 1);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering.reset(ordering);
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;
  options.gradient_tolerance = 1e-12;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (i > 0) state->rig_from_camera[i] = rigid_from_parameters(cameras[i].data());
    if (!state->intrinsics[i].allFinite()) return false;
  }
  for (std::size_t i = 0; i < boards.size(); ++i)
    state->rig_from_board[i] = rigid_from_parameters(boards[i].data());
  return summary.IsSolutionUsable();
}

std::optional<Vector2> residual(const Problem& problem, const State& state, const View& view,
                                const Corner& corner) {
  Vector2 px;
  if (!project(state.intrinsics[view.camera], state.rig_from_camera[view.camera],
               state.rig_from_board[view.instant], problem.points[static_cast<std::size_t>(corner.point)],
               state.bend, &px, nullptr))
    return std::nullopt;
  return corner.px - px;
}

double squared_sigmas(const Corner& corner, const Vector2& r, double extra_px) {
  const Matrix2 covariance = corner.covariance_px2 + extra_px * extra_px * Matrix2::Identity();
  return r.dot(covariance.inverse() * r);
}

std::vector<Reduced> reduce(const Problem& problem, const State& state) {
  const auto shared = static_cast<Eigen::Index>(problem.shared_count(state));
  const auto cameras = static_cast<Eigen::Index>(state.cameras());
  struct Parts {
    Eigen::MatrixXd a, b;
    Matrix6 c = Matrix6::Zero();
    Eigen::VectorXd g;
    Vector6 h = Vector6::Zero();
  };
  std::vector<Parts> parts(state.rig_from_board.size());
  for (Parts& p : parts) {
    p.a = Eigen::MatrixXd::Zero(shared, shared);
    p.b = Eigen::MatrixXd::Zero(shared, 6);
    p.g = Eigen::VectorXd::Zero(shared);
  }
  Eigen::Matrix<double, 2, Eigen::Dynamic> j(2, shared);
  for (const View& v : problem.views)
    for (const Corner& c : v.corners) {
      Vector2 px;
      PixelDerivatives d;
      if (!c.used || !project(state.intrinsics[v.camera], state.rig_from_camera[v.camera],
                              state.rig_from_board[v.instant],
                              problem.points[static_cast<std::size_t>(c.point)], state.bend, &px, &d))
        continue;
      const Matrix2 w = whitening(c, state.extra_px);
      const auto camera = static_cast<Eigen::Index>(v.camera);
      j.setZero();
      j.middleCols<kIntrinsics>(camera * kIntrinsics) = w * d.intrinsics;
      if (!problem.free_k3) j.col(camera * kIntrinsics + kIntrinsics - 1).setZero();
      if (camera > 0) j.middleCols<6>(cameras * kIntrinsics + 6 * (camera - 1)) = w * d.rig_from_camera;
      if (problem.free_bend) j.rightCols<kBend>() = w * d.bend;
      const Eigen::Matrix<double, 2, 6> jb = w * d.rig_from_board;
      const Vector2 r = w * (c.px - px);
      Parts& p = parts[v.instant];
      p.a.noalias() += j.transpose() * j;
      p.b.noalias() += j.transpose() * jb;
      p.c.noalias() += jb.transpose() * jb;
      p.g.noalias() += j.transpose() * r;
      p.h.noalias() += jb.transpose() * r;
    }
  std::vector<Reduced> reduced;
  for (const Parts& p : parts) {
    const Eigen::LDLT<Matrix6> solver(p.c);
    if (p.c.trace() <= 0 || solver.info() != Eigen::Success) {
      reduced.push_back({Eigen::MatrixXd::Zero(shared, shared), Eigen::VectorXd::Zero(shared)});
      continue;
    }
    reduced.push_back({p.a - p.b * solver.solve(p.b.transpose()), p.g - p.b * solver.solve(p.h)});
  }
  return reduced;
}

std::optional<Eigen::MatrixXd> shared_covariance(const std::vector<Reduced>& parts, double scale) {
  if (parts.empty()) return std::nullopt;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(parts[0].information.rows(), parts[0].information.cols());
  for (const Reduced& p : parts) sum += p.information;
  const Eigen::Index n = sum.rows();
  // Scaled to a unit diagonal, so that pixels and k3 are of one size; held parameters stay out.
  Eigen::VectorXd unit(n);
  for (Eigen::Index i = 0; i < n; ++i) unit(i) = sum(i, i) > 0 ? 1 / std::sqrt(sum(i, i)) : 0;
  Eigen::MatrixXd normal = unit.asDiagonal() * sum * unit.asDiagonal();
  for (Eigen::Index i = 0; i < n; ++i)
    if (unit(i) == 0) normal(i, i) = 1;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(normal);
  if (eigen.info() != Eigen::Success || !(eigen.eigenvalues()(0) > 1e-13)) return std::nullopt;
  const Eigen::MatrixXd inverse = eigen.eigenvectors() * eigen.eigenvalues().cwiseInverse().asDiagonal() *
                                  eigen.eigenvectors().transpose();
  return Eigen::MatrixXd(scale * scale * (unit.asDiagonal() * inverse * unit.asDiagonal()));
}

}  // namespace gnathion::camera_problem
