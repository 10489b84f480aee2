#include "calibration/chain_problem.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "calibration/se3_manifold.h"

namespace gnathion {
namespace {

constexpr int kRounds = 12;
constexpr double kStill_mm = 2e-4;  // of a pose between rounds, at the term's points
constexpr std::size_t kLeastPairs = 100;

using RowMatrix67 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

/// ∂(left perturbation of the term's pose)/∂(left perturbation of poses[left], poses[right]).
/// X = A⁻¹B: exp(b) on B moves X by Ad_{A⁻¹}b, exp(a) on A by −Ad_{A⁻¹}a.
struct TermJacobians {
  Matrix6 by_left = Matrix6::Zero(), by_right = Matrix6::Identity();
};
TermJacobians term_jacobians(const SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  TermJacobians j;
  if (!term.left) return j;
  j.by_right = adjoint(poses[static_cast<std::size_t>(*term.left)].inverse());
  j.by_left = -j.by_right;
  return j;
}

/// All residuals of one term, √w·n·(X p − q)/σ, with weights held for the round.
class TermCost final : public ceres::CostFunction {
 public:
  explicit TermCost(const SurfaceTerm& term) : term_(term) {
    for (const PlanePair& p : term.pairs) {
      if (p.weight > 0.0) used_.push_back(&p);
    }
    set_num_residuals(static_cast<int>(used_.size()));
    if (term.left) mutable_parameter_block_sizes()->push_back(7);
    mutable_parameter_block_sizes()->push_back(7);
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const bool two = term_.left.has_value();
    const Rigid3 a = two ? rigid_from_parameters(parameters[0]) : Rigid3::identity();
    const Rigid3 b = rigid_from_parameters(parameters[two ? 1 : 0]);
    const Rigid3 x = a.inverse() * b;
    const Matrix6 by_right = adjoint(a.inverse());
    // Ceres multiplies by the manifold's PlusJacobian; MinusJacobian is its left inverse.
    RowMatrix67 lift_left = RowMatrix67::Zero(), lift_right = RowMatrix67::Zero();
    const Se3Manifold manifold;
    if (jacobians != nullptr) {
      if (two) manifold.MinusJacobian(parameters[0], lift_left.data());
      manifold.MinusJacobian(parameters[two ? 1 : 0], lift_right.data());
      lift_left = -by_right * lift_left;
      lift_right = by_right * lift_right;
    }
    for (std::size_t i = 0; i < used_.size(); ++i) {
      const double factor = std::sqrt(used_[i]->weight) / term_.scale_mm;
      residuals[i] = factor * used_[i]->residual_mm(x);
      if (jacobians == nullptr) continue;
      const Vector6 j = factor * used_[i]->jacobian(x);
      using Row7 = Eigen::Matrix<double, 1, 7>;
      if (two && jacobians[0] != nullptr) {
        Eigen::Map<Row7>(jacobians[0] + 7 * i) = j.transpose() * lift_left;
      }
      double* right = jacobians[two ? 1 : 0];
      if (right != nullptr) Eigen::Map<Row7>(right + 7 * i) = j.transpose() * lift_right;
    }
    return true;
  }

 private:
  const SurfaceTerm& term_;
  std::vector<const PlanePair*> used_;
};

/// Mean residuals of the term's pairs by patches, and what weight a patch has.
class PatchWeights {
 public:
  PatchWeights(const std::vector<PlanePair>& pairs, const Rigid3& x, double scale_mm) : scale_mm_(scale_mm) {
    for (const PlanePair& p : pairs) {
      Patch& patch = patches_[key(p)];
      patch.sum += p.weight * p.residual_mm(x);
      patch.weight += p.weight;
    }
  }
  void apply(std::vector<PlanePair>& pairs) const {
    constexpr double kTukey = 4.685;
    for (PlanePair& p : pairs) {
      const auto found = patches_.find(key(p));
      const bool known = found != patches_.end() && found->second.weight > 0.0;
      const double u = known ? found->second.sum / found->second.weight / (kTukey * scale_mm_) : 1.0;
      p.weight *= std::abs(u) < 1.0 ? (1.0 - u * u) * (1.0 - u * u) : 0.0;
    }
  }

 private:
  struct Patch {
    double sum = 0.0, weight = 0.0;
  };
  using Key = std::array<long, 3>;
  static Key key(const PlanePair& p) {
    constexpr double kPatch_mm = 10.0;
    return {std::lround(p.target_mm.x() / kPatch_mm), std::lround(p.target_mm.y() / kPatch_mm),
            std::lround(p.target_mm.z() / kPatch_mm)};
  }
  double scale_mm_;
  std::map<Key, Patch> patches_;
};

void associate_term(SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  const Rigid3 x = pose_of(term, poses);
  term.pairs = associate(term.fitted, *term.surface, term.keep, x, {term.gate_mm, term.min_normal_cosine});
  term.scale_mm = std::min(term.scale_cap_mm, robust_scale_mm(term.pairs, x, term.noise_floor_mm));
  weigh(term.pairs, x, term.scale_mm);
  if (term.patch_scale_mm > 0.0) PatchWeights(term.pairs, x, term.patch_scale_mm).apply(term.pairs);
}

struct Parameters {
  std::vector<PoseParameters> blocks;
  Se3Manifold manifold;
};

void build(ceres::Problem& problem, Parameters& parameters, const std::vector<Rigid3>& poses,
           const std::vector<SurfaceTerm>& terms) {
  parameters.blocks.clear();
  for (const Rigid3& pose : poses) parameters.blocks.push_back(pose_parameters(pose));
  for (PoseParameters& block : parameters.blocks) {
    problem.AddParameterBlock(block.data(), 7, &parameters.manifold);
  }
  for (const SurfaceTerm& term : terms) {
    std::vector<double*> blocks;
    if (term.left) blocks.push_back(parameters.blocks[static_cast<std::size_t>(*term.left)].data());
    blocks.push_back(parameters.blocks[static_cast<std::size_t>(term.right)].data());
    problem.AddResidualBlock(new TermCost(term), nullptr, blocks);
  }
}

ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

/// One round: fixed correspondences and weights.
Status solve_round(std::vector<Rigid3>& poses, const std::vector<SurfaceTerm>& terms) {
  ceres::Problem problem(problem_options());
  Parameters parameters;
  build(problem, parameters, poses, terms);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 12;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) {
    return fail(ErrorCode::kInternal, "cannot solve", "chain", summary.message);
  }
  for (std::size_t i = 0; i < poses.size(); ++i)
    poses[i] = rigid_from_parameters(parameters.blocks[i].data());
  return {};
}

/// Inverse of the joint information matrix, in the tangent space.
Result<Eigen::MatrixXd> inverse_information(const std::vector<Rigid3>& poses,
                                            const std::vector<SurfaceTerm>& terms) {
  ceres::Problem problem(problem_options());
  Parameters parameters;
  build(problem, parameters, poses, terms);
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::DENSE_SVD;
  options.num_threads = 1;
  ceres::Covariance covariance(options);
  std::vector<const double*> blocks;
  for (const PoseParameters& block : parameters.blocks) blocks.push_back(block.data());
  if (!covariance.Compute(blocks, &problem)) {
    return bad_input("cannot solve", "chain", "the surfaces leave a direction of the chain undetermined");
  }
  const auto n = static_cast<long>(6 * poses.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> out(n, n);
  covariance.GetCovarianceMatrixInTangentSpace(blocks, out.data());
  return Eigen::MatrixXd(out);
}

/// A term's score carried to the joint state: rows of the 6 × 6n map.
Eigen::MatrixXd joint_map(const SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(6, static_cast<long>(6 * poses.size()));
  const TermJacobians j = term_jacobians(term, poses);
  if (term.left) map.block<6, 6>(0, 6 * *term.left) = j.by_left;
  map.block<6, 6>(0, 6 * term.right) = j.by_right;
  return map;
}

/// H⁻¹·(cov of the score)·H⁻¹ with noise that is correlated over the surfaces, plus the scanners' scale
/// errors, each of which moves all of its terms together.
Eigen::MatrixXd robust_covariance(const Eigen::MatrixXd& bread, const std::vector<Rigid3>& poses,
                                  const std::vector<SurfaceTerm>& terms,
                                  const std::vector<double>& scale_sigmas) {
  Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(bread.rows(), bread.cols());
  std::vector<Eigen::VectorXd> scale_scores(scale_sigmas.size(), Eigen::VectorXd::Zero(bread.rows()));
  for (const SurfaceTerm& term : terms) {
    const Rigid3 x = pose_of(term, poses);
    const Eigen::MatrixXd map = joint_map(term, poses);
    const double s2 = term.scale_mm * term.scale_mm;
    meat += map.transpose() * score_covariance(term.pairs, x, term.noise) * map / (s2 * s2);
    if (term.scanner >= 0) {
      scale_scores[static_cast<std::size_t>(term.scanner)] +=
          map.transpose() * source_scale_score(term.pairs, x, term.scale_centre_mm) / s2;
    }
    if (term.surface_scanner >= 0) {
      scale_scores[static_cast<std::size_t>(term.surface_scanner)] +=
          map.transpose() * target_scale_score(term.pairs, x, term.surface_scale_centre_mm) / s2;
    }
  }
  for (std::size_t i = 0; i < scale_sigmas.size(); ++i) {
    meat += scale_sigmas[i] * scale_sigmas[i] * scale_scores[i] * scale_scores[i].transpose();
  }
  const Eigen::MatrixXd covariance = bread * meat * bread;
  return 0.5 * (covariance + covariance.transpose());
}

double largest_move_mm(const SurfaceTerm& term, const Rigid3& before, const Rigid3& after) {
  double largest = 0.0;
  for (std::size_t i = 0; i < term.fitted.size(); i += 97) {
    largest =
        std::max(largest, (before * term.fitted.points_mm[i] - after * term.fitted.points_mm[i]).norm());
  }
  return largest;
}

void describe(SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  const Rigid3 x = pose_of(term, poses);
  term.rms_mm = weighted_rms_mm(term.pairs, x);
  // Patches are judged by the fitted points alone.
  std::vector<PlanePair> judges = term.pairs;
  weigh(judges, x, term.scale_mm);
  std::vector<PlanePair> unseen =
      associate(term.held_out, *term.surface, term.keep, x, {term.gate_mm, term.min_normal_cosine});
  weigh(unseen, x, term.scale_mm);
  if (term.patch_scale_mm > 0.0) PatchWeights(judges, x, term.patch_scale_mm).apply(unseen);
  term.held_out_mm = weighted_rms_mm(unseen, x);
  term.noise = estimate_noise(term.pairs, x);
}

}  // namespace

Rigid3 pose_of(const SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  const Rigid3& right = poses[static_cast<std::size_t>(term.right)];
  return term.left ? poses[static_cast<std::size_t>(*term.left)].inverse() * right : right;
}

void set_samples(SurfaceTerm& term, const SurfaceSamples& all) {
  for (std::size_t i = 0; i < all.size(); ++i) {
    (i % 5 == 4 ? term.held_out : term.fitted).push_back(all.points_mm[i], all.normals[i], all.triangles[i]);
  }
}

Result<ChainSolution> solve_poses(std::vector<Rigid3> start, std::vector<SurfaceTerm>& terms,
                                  const std::vector<double>& scanner_scale_sigmas) {
  ChainSolution solution;
  solution.poses = std::move(start);
  for (int round = 0; round < kRounds; ++round) {
    for (SurfaceTerm& term : terms) {
      associate_term(term, solution.poses);
      const auto used = static_cast<std::size_t>(std::count_if(
          term.pairs.begin(), term.pairs.end(), [](const PlanePair& p) { return p.weight > 0.0; }));
      if (used < kLeastPairs) {
        return bad_input("cannot solve chain", term.name,
                         fmt::format("only {} points of the scan lie on the surface", used));
      }
    }
    const std::vector<Rigid3> before = solution.poses;
    GNATHION_CHECK_OK(solve_round(solution.poses, terms));
    double moved = 0.0;
    for (const SurfaceTerm& term : terms) {
      moved = std::max(moved, largest_move_mm(term, pose_of(term, before), pose_of(term, solution.poses)));
    }
    if (moved < kStill_mm) break;
  }
  for (SurfaceTerm& term : terms) {
    associate_term(term, solution.poses);
    describe(term, solution.poses);
  }
  GNATHION_TRY(const Eigen::MatrixXd bread, inverse_information(solution.poses, terms));
  solution.covariance = robust_covariance(bread, solution.poses, terms, scanner_scale_sigmas);
  return solution;
}

}  // namespace gnathion
