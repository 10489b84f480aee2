// The bundle adjustment of a tag layout and its covariance.
#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "calibration/bow_layout.h"
#include "calibration/se3_manifold.h"

namespace gnathion {
namespace {

constexpr const char* kCannotAdjust = "cannot calibrate the body's tags";
using RowMatrix67 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

RowMatrix67 lift(const double* pose) {
  RowMatrix67 m;
  Se3Manifold().MinusJacobian(pose, m.data());
  return m;
}

/// Writes an 8×N Jacobian row-major where it is asked for.
template <int N, class Value>
void store(double* to, const Value& value) {
  if (to == nullptr) return;
  const Eigen::Matrix<double, 8, N> m = value();
  for (int r = 0; r < 8; ++r)
    for (int c = 0; c < N; ++c) to[r * N + c] = m(r, c);
}

/// Blocks: rig_from_body (7), body_from_tag (7), log sizes (2), log scale (1). Ceres multiplies by the
/// manifold's PlusJacobian; MinusJacobian is its left inverse.
class TagCost final : public ceres::SizedCostFunction<8, 7, 7, 2, 1> {
 public:
  TagCost(const RigCamera& camera, const LayoutObservation& o, const LayoutTag& tag)
      : camera_(camera), observation_(o) {
    observation_.tag = 0;
    layout_.tags = {tag};
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    TagLayout layout = layout_;
    layout.tags[0].body_from_tag = rigid_from_parameters(parameters[1]);
    layout.tags[0].log_width = parameters[2][0];
    layout.tags[0].log_height = parameters[2][1];
    layout.log_scale = parameters[3][0];
    ObservationTerms terms;
    if (!evaluate_observation(camera_, observation_, layout, rigid_from_parameters(parameters[0]), terms))
      return false;
    Eigen::Map<Eigen::Matrix<double, 8, 1>> r(residuals);
    r = terms.residual;
    if (jacobians == nullptr) return true;
    store<7>(jacobians[0], [&] { return (terms.by_view * lift(parameters[0])).eval(); });
    store<7>(jacobians[1], [&] { return (terms.by_tag * lift(parameters[1])).eval(); });
    store<2>(jacobians[2], [&] { return terms.by_size; });
    store<1>(jacobians[3], [&] { return terms.by_scale; });
    return true;
  }

 private:
  const RigCamera& camera_;
  LayoutObservation observation_;
  TagLayout layout_;
};

template <int N>
class PriorCost final : public ceres::SizedCostFunction<N, N> {
 public:
  PriorCost(double mean, double sigma) : mean_(mean), sigma_(sigma) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    for (int i = 0; i < N; ++i) residuals[i] = (parameters[0][i] - mean_) / sigma_;
    if (jacobians != nullptr && jacobians[0] != nullptr)
      for (int i = 0; i < N * N; ++i) jacobians[0][i] = i % (N + 1) == 0 ? 1 / sigma_ : 0;
    return true;
  }

 private:
  double mean_, sigma_;
};

/// The mean of all tags' logarithms of width and height is 0: the common scale is the mean side's.
class MeanSizeCost final : public ceres::CostFunction {
 public:
  explicit MeanSizeCost(std::size_t tags) : weight_(1 / (kMeanSizeSigma * 2 * static_cast<double>(tags))) {
    mutable_parameter_block_sizes()->assign(tags, 2);
    set_num_residuals(1);
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    residuals[0] = 0;
    for (std::size_t t = 0; t < parameter_block_sizes().size(); ++t) {
      residuals[0] += weight_ * (parameters[t][0] + parameters[t][1]);
      if (jacobians != nullptr && jacobians[t] != nullptr) jacobians[t][0] = jacobians[t][1] = weight_;
    }
    return true;
  }

 private:
  static constexpr double kMeanSizeSigma = 1e-6;
  double weight_;
};

}  // namespace

Status adjust_layout(const std::vector<RigCamera>& cameras,
                     const std::vector<LayoutObservation>& observations, const LayoutPrior& prior,
                     double huber, LayoutState& state) {
  std::vector<PoseParameters> views, tags;
  std::vector<Eigen::Vector2d> sizes;
  double scale = state.layout.log_scale;
  for (const Rigid3& pose : state.rig_from_body) views.push_back(pose_parameters(pose));
  for (const LayoutTag& tag : state.layout.tags) {
    tags.push_back(pose_parameters(tag.body_from_tag));
    sizes.emplace_back(tag.log_width, tag.log_height);
  }
  ceres::Problem::Options ownership;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  Se3Manifold manifold;
  ceres::HuberLoss loss(huber);
  ceres::Problem problem(ownership);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  std::vector<bool> seen(views.size(), false);
  int held = -1;
  for (const LayoutObservation& o : observations) {
    if (!o.used) continue;
    const auto v = static_cast<std::size_t>(o.view), t = static_cast<std::size_t>(o.tag);
    problem.AddResidualBlock(
        new TagCost(cameras[static_cast<std::size_t>(o.camera)], o, state.layout.tags[t]), &loss,
        views[v].data(), tags[t].data(), sizes[t].data(), &scale);
    seen[v] = true;
    if (held < 0) held = o.view;
  }
  if (held < 0) return bad_input(kCannotAdjust, "film", "no view is left");
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (!seen[v]) continue;
    problem.SetManifold(views[v].data(), &manifold);
    ordering->AddElementToGroup(views[v].data(), 0);
  }
  std::vector<double*> size_blocks;
  for (std::size_t t = 0; t < tags.size(); ++t) {
    if (!problem.HasParameterBlock(tags[t].data())) continue;
    problem.SetManifold(tags[t].data(), &manifold);
    problem.AddResidualBlock(new PriorCost<2>(0, prior.size_sigma), nullptr, sizes[t].data());
    ordering->AddElementToGroup(tags[t].data(), 1);
    ordering->AddElementToGroup(sizes[t].data(), 1);
    size_blocks.push_back(sizes[t].data());
  }
  problem.AddResidualBlock(new MeanSizeCost(size_blocks.size()), nullptr, size_blocks);
  ordering->AddElementToGroup(&scale, 1);
  problem.AddResidualBlock(new PriorCost<1>(prior.log_scale, prior.log_scale_sigma), nullptr, &scale);
  if (prior.scale_fixed) problem.SetParameterBlockConstant(&scale);
  problem.SetParameterBlockConstant(views[static_cast<std::size_t>(held)].data());

  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.num_threads = 1;  // sums in one order: the same bytes every time
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-11;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable())
    return bad_input(kCannotAdjust, "film", "the adjustment failed: " + summary.message);
  for (std::size_t v = 0; v < views.size(); ++v)
    state.rig_from_body[v] = rigid_from_parameters(views[v].data());
  for (std::size_t t = 0; t < tags.size(); ++t) {
    state.layout.tags[t].body_from_tag = rigid_from_parameters(tags[t].data());
    state.layout.tags[t].log_width = sizes[t].x();
    state.layout.tags[t].log_height = sizes[t].y();
  }
  state.layout.log_scale = scale;
  return {};
}

namespace {

/// Local parameters of the layout, all about a millimetre at a corner: per tag the centre's shift, its turn
/// about the centre times the side, width and height; last the scale times 100 mm.
constexpr int kPerTag = 8;
constexpr double kScaleArm_mm = 100;

/// ∂(left perturbation of body_from_tag)/∂(shift of the centre, turn about it times side).
Matrix6 about_centre(const LayoutTag& tag) {
  Matrix6 m = Matrix6::Zero();
  const double arm = tag.nominal_side_mm;
  m.topRightCorner<3, 3>() = Matrix3::Identity() / arm;
  m.bottomLeftCorner<3, 3>() = Matrix3::Identity();
  m.bottomRightCorner<3, 3>() = skew(tag.body_from_tag.translation_mm) / arm;
  return m;
}

struct ReducedProblem {
  Eigen::MatrixXd information;
  Eigen::VectorXd by_focal;  ///< gradient by a relative change of the focal length
};

/// The information of the layout with the views eliminated one by one.
ReducedProblem reduced(const std::vector<RigCamera>& cameras,
                       const std::vector<LayoutObservation>& observations, const LayoutPrior& prior,
                       const LayoutState& state) {
  const int n = static_cast<int>(state.layout.tags.size());
  const int size = kPerTag * n + 1;
  ReducedProblem out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
  std::vector<std::vector<const LayoutObservation*>> by_view(state.rig_from_body.size());
  for (const LayoutObservation& o : observations)
    if (o.used) by_view[static_cast<std::size_t>(o.view)].push_back(&o);
  ObservationTerms terms;
  for (std::size_t v = 0; v < by_view.size(); ++v) {
    if (by_view[v].empty()) continue;
    Matrix6 view_information = Matrix6::Zero();
    Vector6 view_focal = Vector6::Zero();
    Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(size, 6);
    for (const LayoutObservation* o : by_view[v]) {
      const auto t = static_cast<std::size_t>(o->tag);
      if (!evaluate_observation(cameras[static_cast<std::size_t>(o->camera)], *o, state.layout,
                                state.rig_from_body[v], terms))
        continue;
      const double side = state.layout.tags[t].nominal_side_mm;
      Eigen::Matrix<double, 8, kPerTag + 1> j;
      j.leftCols<6>() = terms.by_tag * about_centre(state.layout.tags[t]);
      j.middleCols<2>(6) = terms.by_size / side;
      j.col(kPerTag) = terms.by_scale / kScaleArm_mm;
      const int at = kPerTag * static_cast<int>(t), last = size - 1;
      const Eigen::Matrix<double, kPerTag + 1, kPerTag + 1> own = j.transpose() * j;
      const Eigen::Matrix<double, kPerTag + 1, 6> mixed = j.transpose() * terms.by_view;
      const Eigen::Matrix<double, kPerTag + 1, 1> focal = j.transpose() * terms.by_focal;
      out.information.block<kPerTag, kPerTag>(at, at) += own.topLeftCorner<kPerTag, kPerTag>();
      out.information.block<kPerTag, 1>(at, last) += own.topRightCorner<kPerTag, 1>();
      out.information.block<1, kPerTag>(last, at) += own.bottomLeftCorner<1, kPerTag>();
      out.information(last, last) += own(kPerTag, kPerTag);
      cross.middleRows<kPerTag>(at) += mixed.topRows<kPerTag>();
      cross.row(last) += mixed.bottomRows<1>();
      out.by_focal.segment<kPerTag>(at) += focal.head<kPerTag>();
      out.by_focal(last) += focal(kPerTag);
      view_information += terms.by_view.transpose() * terms.by_view;
      view_focal += terms.by_view.transpose() * terms.by_focal;
    }
    const Eigen::LDLT<Matrix6> solver(view_information);
    out.information -= cross * solver.solve(cross.transpose());
    out.by_focal -= cross * solver.solve(view_focal);
  }
  for (int t = 0; t < n; ++t)
    for (int i = 6; i < 8; ++i) {
      const double side = state.layout.tags[static_cast<std::size_t>(t)].nominal_side_mm;
      out.information(kPerTag * t + i, kPerTag * t + i) += 1 / std::pow(prior.size_sigma * side, 2);
    }
  out.information(size - 1, size - 1) += 1 / std::pow(prior.log_scale_sigma * kScaleArm_mm, 2);
  return out;
}

/// ∂corners/∂local parameters.
Eigen::MatrixXd corner_jacobian(const TagLayout& layout) {
  const int n = static_cast<int>(layout.tags.size());
  Eigen::MatrixXd j = Eigen::MatrixXd::Zero(12 * n, kPerTag * n + 1);
  for (int t = 0; t < n; ++t)
    for (int k = 0; k < 4; ++k) {
      const LayoutTag& tag = layout.tags[static_cast<std::size_t>(t)];
      const Vector3 q = layout.corner_in_tag(static_cast<std::size_t>(t), static_cast<std::size_t>(k));
      const Matrix3& r = tag.body_from_tag.rotation;
      const int row = 12 * t + 3 * k, at = kPerTag * t;
      j.block<3, 3>(row, at) = Matrix3::Identity();
      j.block<3, 3>(row, at + 3) = -skew(r * q) / tag.nominal_side_mm;
      j.block<3, 1>(row, at + 6) = r.col(0) * q.x() / tag.nominal_side_mm;
      j.block<3, 1>(row, at + 7) = r.col(1) * q.y() / tag.nominal_side_mm;
      j.block<3, 1>(row, kPerTag * n) = r * q / kScaleArm_mm;
    }
  return j;
}

/// What holds exactly. The gauge: Σ shifts = 0 and Σ nominal × shift = 0, as the best rigid fit to the
/// nominal corners has it; and the mean size, which is the common scale's.
Eigen::MatrixXd constraints(const std::vector<Vector3>& nominal, const Eigen::MatrixXd& corners_by_local) {
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(6, 3 * static_cast<int>(nominal.size()));
  Vector3 centre = Vector3::Zero();
  for (const Vector3& p : nominal) centre += p / static_cast<double>(nominal.size());
  for (std::size_t i = 0; i < nominal.size(); ++i) {
    const int at = 3 * static_cast<int>(i);
    rows.block<3, 3>(0, at) = Matrix3::Identity();
    rows.block<3, 3>(3, at) = skew(nominal[i] - centre) / 50.0;
  }
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(7, corners_by_local.cols());
  out.topRows(6) = rows * corners_by_local;
  for (Eigen::Index t = 0; t < (out.cols() - 1) / kPerTag; ++t) out.block<1, 2>(6, kPerTag * t + 6).setOnes();
  return out;
}

/// Covariance of the constrained minimum from the bordered system [H Cᵀ; C 0].
Eigen::MatrixXd bordered_inverse(const Eigen::MatrixXd& information, const Eigen::MatrixXd& rows) {
  const auto n = information.rows(), m = rows.rows();
  Eigen::MatrixXd bordered = Eigen::MatrixXd::Zero(n + m, n + m);
  // The rows are scaled to the information, which does not change the constrained inverse.
  const double weight = information.diagonal().mean() / std::max(1e-12, rows.cwiseAbs().maxCoeff());
  bordered.topLeftCorner(n, n) = information;
  bordered.topRightCorner(n, m) = weight * rows.transpose();
  bordered.bottomLeftCorner(m, n) = weight * rows;
  const Eigen::MatrixXd inverse = bordered.partialPivLu().inverse();
  const Eigen::MatrixXd block = inverse.topLeftCorner(n, n);
  return 0.5 * (block + block.transpose());
}

}  // namespace

Result<LayoutCovariance> layout_covariance(const std::vector<RigCamera>& cameras,
                                           const std::vector<LayoutObservation>& observations,
                                           const LayoutPrior& prior, const LayoutState& state,
                                           const std::vector<Vector3>& nominal_corners_mm) {
  const ReducedProblem problem = reduced(cameras, observations, prior, state);
  const auto size = problem.information.rows(), shape = size - 1;
  const Eigen::MatrixXd j = corner_jacobian(state.layout);
  const Eigen::MatrixXd rows = constraints(nominal_corners_mm, j);
  const Eigen::MatrixXd all = bordered_inverse(problem.information, rows);
  const Eigen::MatrixXd held =
      bordered_inverse(problem.information.topLeftCorner(shape, shape), rows.leftCols(shape));
  LayoutCovariance out;
  out.total = j * all * j.transpose();
  out.shape = j.leftCols(shape) * held * j.leftCols(shape).transpose();
  if (!out.total.allFinite() || !out.shape.allFinite() || out.total.diagonal().minCoeff() < 0 ||
      all(size - 1, size - 1) < 0)
    return bad_input(kCannotAdjust, "film",
                     "the views do not determine the tags: turn the body more, near the camera");
  out.log_scale_sigma = std::sqrt(all(size - 1, size - 1)) / kScaleArm_mm;
  out.corner_by_focal_mm = -j * all * problem.by_focal;
  return out;
}

}  // namespace gnathion
