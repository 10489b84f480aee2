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

/// How the residual changes with the scale of its source and of its surface.
double by_source_scale(const SurfaceTerm& term, const PlanePair& p, const Rigid3& x) {
  return -p.normal.dot(x.rotation * (p.source_mm - term.scale_centre_mm));
}
double by_surface_scale(const SurfaceTerm& term, const PlanePair& p) {
  return p.normal.dot(p.target_mm - term.surface_scale_centre_mm);
}

/// All residuals of one term, √w·(n·(X p − q) + scales)/σ, with weights held for the round. The pairs are
/// corrected for the scales before (see associate_term); the parameters here are what is left. Blocks:
/// poses[left] if any, poses[right], then the scales of the term's scanners (one block if they are one).
class TermCost final : public ceres::CostFunction {
 public:
  explicit TermCost(const SurfaceTerm& term) : term_(term) {
    for (const PlanePair& p : term.pairs) {
      if (p.weight > 0.0) used_.push_back(&p);
    }
    set_num_residuals(static_cast<int>(used_.size()));
    if (term.left) mutable_parameter_block_sizes()->push_back(7);
    mutable_parameter_block_sizes()->push_back(7);
    for (std::size_t k = 0; k < scanners_of(term).size(); ++k) mutable_parameter_block_sizes()->push_back(1);
  }

  static std::vector<int> scanners_of(const SurfaceTerm& term) {
    std::vector<int> out;
    if (term.scanner >= 0) out.push_back(term.scanner);
    if (term.surface_scanner >= 0 && term.surface_scanner != term.scanner)
      out.push_back(term.surface_scanner);
    return out;
  }

  /// ∂residual/∂scale of scanner `scanner`.
  static double by_scale(const SurfaceTerm& term, int scanner, const PlanePair& p, const Rigid3& x) {
    double d = 0.0;
    if (term.scanner == scanner) d += by_source_scale(term, p, x);
    if (term.surface_scanner == scanner) d += by_surface_scale(term, p);
    return d;
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const bool two = term_.left.has_value();
    const Rigid3 a = two ? rigid_from_parameters(parameters[0]) : Rigid3::identity();
    const std::size_t right = two ? 1 : 0;
    const Rigid3 x = a.inverse() * rigid_from_parameters(parameters[right]);
    const std::vector<int> scanners = scanners_of(term_);
    // Ceres multiplies by the manifold's PlusJacobian; MinusJacobian is its left inverse.
    RowMatrix67 lift_left = RowMatrix67::Zero(), lift_right = RowMatrix67::Zero();
    const Se3Manifold manifold;
    if (jacobians != nullptr) {
      const Matrix6 by_right = adjoint(a.inverse());
      if (two) manifold.MinusJacobian(parameters[0], lift_left.data());
      manifold.MinusJacobian(parameters[right], lift_right.data());
      lift_left = -by_right * lift_left;
      lift_right = by_right * lift_right;
    }
    using Row7 = Eigen::Matrix<double, 1, 7>;
    for (std::size_t i = 0; i < used_.size(); ++i) {
      const PlanePair& p = *used_[i];
      const double factor = std::sqrt(p.weight) / term_.scale_mm;
      double residual = p.residual_mm(x);
      for (std::size_t k = 0; k < scanners.size(); ++k) {
        const double d = by_scale(term_, scanners[k], p, x);
        const double known = scanners[k] == term_.scanner ? term_.source_scale : term_.surface_scale;
        residual += d * (parameters[right + 1 + k][0] - known);
        if (jacobians != nullptr && jacobians[right + 1 + k] != nullptr)
          jacobians[right + 1 + k][i] = factor * d;
      }
      residuals[i] = factor * residual;
      if (jacobians == nullptr) continue;
      const Vector6 j = factor * p.jacobian(x);
      if (two && jacobians[0] != nullptr) Eigen::Map<Row7>(jacobians[0] + 7 * i) = j.transpose() * lift_left;
      if (jacobians[right] != nullptr)
        Eigen::Map<Row7>(jacobians[right] + 7 * i) = j.transpose() * lift_right;
    }
    return true;
  }

 private:
  const SurfaceTerm& term_;
  std::vector<const PlanePair*> used_;
};

/// The scanner's promise about its scale: s/σ.
class ScalePrior final : public ceres::SizedCostFunction<1, 1> {
 public:
  explicit ScalePrior(double sigma) : sigma_(sigma) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    residuals[0] = parameters[0][0] / sigma_;
    if (jacobians != nullptr && jacobians[0] != nullptr) jacobians[0][0] = 1.0 / sigma_;
    return true;
  }

 private:
  double sigma_;
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

/// Samples with their scanner's scale taken out.
SurfaceSamples unscaled(const SurfaceSamples& samples, const Vector3& centre_mm, double scale) {
  SurfaceSamples out = samples;
  for (Vector3& p : out.points_mm) p -= scale * (p - centre_mm);
  return out;
}

/// Pairs as they are when both scales are taken out; distances are still those of the surface as scanned,
/// which the scale moves by hundredths of a millimetre only.
std::vector<PlanePair> corrected_pairs(const SurfaceTerm& term, const SurfaceSamples& samples,
                                       const Rigid3& x) {
  std::vector<PlanePair> pairs =
      associate(unscaled(samples, term.scale_centre_mm, term.source_scale), *term.surface, term.keep, x,
                {term.gate_mm, term.min_normal_cosine});
  for (PlanePair& p : pairs) p.target_mm -= term.surface_scale * (p.target_mm - term.surface_scale_centre_mm);
  return pairs;
}

void associate_term(SurfaceTerm& term, const ChainSolution& at) {
  const Rigid3 x = pose_of(term, at.poses);
  if (term.scanner >= 0) term.source_scale = at.scales[static_cast<std::size_t>(term.scanner)];
  if (term.surface_scanner >= 0)
    term.surface_scale = at.scales[static_cast<std::size_t>(term.surface_scanner)];
  term.pairs = corrected_pairs(term, term.fitted, x);
  term.scale_mm = std::min(term.scale_cap_mm, robust_scale_mm(term.pairs, x, term.noise_floor_mm));
  weigh(term.pairs, x, term.scale_mm);
  if (term.patch_scale_mm > 0.0) PatchWeights(term.pairs, x, term.patch_scale_mm).apply(term.pairs);
}

struct Parameters {
  std::vector<PoseParameters> poses;
  std::vector<double> scales;
  Se3Manifold manifold;
};

void build(ceres::Problem& problem, Parameters& parameters, const ChainSolution& at,
           const std::vector<SurfaceTerm>& terms, const std::vector<double>& scale_sigmas) {
  for (const Rigid3& pose : at.poses) parameters.poses.push_back(pose_parameters(pose));
  parameters.scales = at.scales;
  for (PoseParameters& block : parameters.poses) {
    problem.AddParameterBlock(block.data(), 7, &parameters.manifold);
  }
  for (std::size_t k = 0; k < parameters.scales.size(); ++k) {
    problem.AddResidualBlock(new ScalePrior(scale_sigmas[k]), nullptr, &parameters.scales[k]);
  }
  for (const SurfaceTerm& term : terms) {
    std::vector<double*> blocks;
    if (term.left) blocks.push_back(parameters.poses[static_cast<std::size_t>(*term.left)].data());
    blocks.push_back(parameters.poses[static_cast<std::size_t>(term.right)].data());
    for (const int k : TermCost::scanners_of(term))
      blocks.push_back(&parameters.scales[static_cast<std::size_t>(k)]);
    problem.AddResidualBlock(new TermCost(term), nullptr, blocks);
  }
}

ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

/// One round: fixed correspondences and weights.
Status solve_round(ChainSolution& at, const std::vector<SurfaceTerm>& terms,
                   const std::vector<double>& scale_sigmas) {
  ceres::Problem problem(problem_options());
  Parameters parameters;
  build(problem, parameters, at, terms, scale_sigmas);
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
  for (std::size_t i = 0; i < at.poses.size(); ++i)
    at.poses[i] = rigid_from_parameters(parameters.poses[i].data());
  at.scales = parameters.scales;
  return {};
}

/// Inverse of the joint information matrix of poses (tangent space) and scales.
Result<Eigen::MatrixXd> inverse_information(const ChainSolution& at, const std::vector<SurfaceTerm>& terms,
                                            const std::vector<double>& scale_sigmas) {
  ceres::Problem problem(problem_options());
  Parameters parameters;
  build(problem, parameters, at, terms, scale_sigmas);
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::DENSE_SVD;
  options.num_threads = 1;
  ceres::Covariance covariance(options);
  std::vector<const double*> blocks;
  for (const PoseParameters& block : parameters.poses) blocks.push_back(block.data());
  for (const double& scale : parameters.scales) blocks.push_back(&scale);
  if (!covariance.Compute(blocks, &problem)) {
    return bad_input("cannot solve", "chain", "the surfaces leave a direction of the chain undetermined");
  }
  const auto n = static_cast<long>(6 * at.poses.size() + at.scales.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> out(n, n);
  covariance.GetCovarianceMatrixInTangentSpace(blocks, out.data());
  return Eigen::MatrixXd(out);
}

/// H⁻¹·(covariance of the scores)·H⁻¹ of poses and scales, with noise that is correlated over the surfaces.
Eigen::MatrixXd robust_covariance(const Eigen::MatrixXd& bread, const ChainSolution& at,
                                  const std::vector<SurfaceTerm>& terms,
                                  const std::vector<double>& scale_sigmas) {
  const auto pose_rows = static_cast<long>(6 * at.poses.size());
  Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(bread.rows(), bread.cols());
  for (std::size_t k = 0; k < scale_sigmas.size(); ++k) {
    meat(pose_rows + static_cast<long>(k), pose_rows + static_cast<long>(k)) +=
        1.0 / (scale_sigmas[k] * scale_sigmas[k]);
  }
  for (const SurfaceTerm& term : terms) {
    const Rigid3 x = pose_of(term, at.poses);
    const std::vector<int> scanners = TermCost::scanners_of(term);
    // The term's own unknowns: its pose, then its scanners' scales.
    const long own = 6 + static_cast<long>(scanners.size());
    ScoreRows rows(own, static_cast<long>(term.pairs.size()));
    for (std::size_t i = 0; i < term.pairs.size(); ++i) {
      const PlanePair& p = term.pairs[i];
      const auto column = static_cast<long>(i);
      rows.col(column).head<6>() = p.jacobian(x);
      for (std::size_t k = 0; k < scanners.size(); ++k) {
        rows(6 + static_cast<long>(k), column) = TermCost::by_scale(term, scanners[k], p, x);
      }
    }
    Eigen::MatrixXd map = Eigen::MatrixXd::Zero(own, bread.rows());
    const TermJacobians j = term_jacobians(term, at.poses);
    if (term.left) map.block<6, 6>(0, 6 * *term.left) = j.by_left;
    map.block<6, 6>(0, 6 * term.right) = j.by_right;
    for (std::size_t k = 0; k < scanners.size(); ++k) {
      map(6 + static_cast<long>(k), pose_rows + scanners[k]) = 1.0;
    }
    const double s2 = term.scale_mm * term.scale_mm;
    meat += map.transpose() * score_covariance(term.pairs, rows, term.noise) * map / (s2 * s2);
  }
  const Eigen::MatrixXd covariance = (bread * meat * bread).topLeftCorner(pose_rows, pose_rows);
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
  std::vector<PlanePair> unseen = corrected_pairs(term, term.held_out, x);
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
  solution.scales.assign(scanner_scale_sigmas.size(), 0.0);
  for (int round = 0; round < kRounds; ++round) {
    for (SurfaceTerm& term : terms) {
      associate_term(term, solution);
      const auto used = static_cast<std::size_t>(std::count_if(
          term.pairs.begin(), term.pairs.end(), [](const PlanePair& p) { return p.weight > 0.0; }));
      if (used < kLeastPairs) {
        return bad_input("cannot solve chain", term.name,
                         fmt::format("only {} points of the scan lie on the surface", used));
      }
    }
    const std::vector<Rigid3> before = solution.poses;
    GNATHION_CHECK_OK(solve_round(solution, terms, scanner_scale_sigmas));
    double moved = 0.0;
    for (const SurfaceTerm& term : terms) {
      moved = std::max(moved, largest_move_mm(term, pose_of(term, before), pose_of(term, solution.poses)));
    }
    if (moved < kStill_mm) break;
  }
  for (SurfaceTerm& term : terms) {
    associate_term(term, solution);
    describe(term, solution.poses);
  }
  GNATHION_TRY(const Eigen::MatrixXd bread, inverse_information(solution, terms, scanner_scale_sigmas));
  solution.covariance = robust_covariance(bread, solution, terms, scanner_scale_sigmas);
  return solution;
}

}  // namespace gnathion
