#include "calibration/chain_problem.h"

#include <ceres/ceres.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "calibration/chain_score.h"
#include "calibration/se3_manifold.h"

namespace gnathion {
namespace {

constexpr int kRounds = 12;
constexpr double kStill_mm = 2e-4;  // of a pose between rounds, at the term's points
constexpr std::size_t kLeastPairs = 100;

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
  for (PlanePair& p : pairs) {
    p.target_mm -= term.surface_scale * (p.target_mm - term.surface_scale_centre_mm);
    if (term.shape) p.target_mm += term.shape->along_mm(p.normal, p.target_mm) * p.normal;
  }
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
}

Status associate_all(std::vector<SurfaceTerm>& terms, const ChainSolution& at) {
  for (SurfaceTerm& term : terms) {
    associate_term(term, at);
    const auto used = std::count_if(term.pairs.begin(), term.pairs.end(),
                                    [](const PlanePair& p) { return p.weight > 0.0; });
    if (used < static_cast<long>(kLeastPairs))
      return bad_input("cannot solve chain", term.name,
                       fmt::format("only {} points of the scan lie on the surface", used));
  }
  return {};
}

/// The problem as Ceres has it, around one solution.
class JointProblem {
 public:
  JointProblem(const ChainProblem& given, const ChainSolution& at, const std::vector<TermScore>& scores)
      : problem_(options()), scales_(at.scales) {
    for (const Rigid3& pose : at.poses) poses_.push_back(pose_parameters(pose));
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      problem_.AddParameterBlock(poses_[i].data(), 7, &manifold_);
      if (!given.fixed.empty() && given.fixed[i]) problem_.SetParameterBlockConstant(poses_[i].data());
    }
    for (std::size_t k = 0; k < scales_.size(); ++k)
      problem_.AddResidualBlock(new ScalePrior(given.scale_sigmas[k]), nullptr, &scales_[k]);
    for (std::size_t i = 0; i < given.terms.size(); ++i) {
      const SurfaceTerm& term = given.terms[i];
      std::vector<double*> blocks;
      if (term.left) blocks.push_back(poses_[static_cast<std::size_t>(*term.left)].data());
      blocks.push_back(poses_[static_cast<std::size_t>(term.right)].data());
      for (const int k : scores[i].scanners) blocks.push_back(&scales_[static_cast<std::size_t>(k)]);
      problem_.AddResidualBlock(new ScoreCost(scores[i], term.left.has_value()), nullptr, blocks);
    }
    for (const KnownPose& known : given.known)
      problem_.AddResidualBlock(new KnownPoseCost(known), nullptr,
                                poses_[static_cast<std::size_t>(known.pose)].data());
  }

  Status solve(ChainSolution& out) {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 20;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    if (!summary.IsSolutionUsable())
      return fail(ErrorCode::kInternal, "cannot solve", "chain", summary.message);
    for (std::size_t i = 0; i < poses_.size(); ++i) out.poses[i] = rigid_from_parameters(poses_[i].data());
    out.scales = scales_;
    return {};
  }

  /// JᵀJ over the tangent spaces of all poses, then the scales; rows of fixed poses are zero.
  Eigen::MatrixXd information() {
    // Columns of the free blocks alone: where each begins among all unknowns.
    ceres::Problem::EvaluateOptions evaluate;
    std::vector<long> unknown;
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      if (problem_.IsParameterBlockConstant(poses_[i].data())) continue;
      evaluate.parameter_blocks.push_back(poses_[i].data());
      for (long k = 0; k < 6; ++k) unknown.push_back(6 * static_cast<long>(i) + k);
    }
    for (std::size_t k = 0; k < scales_.size(); ++k) {
      evaluate.parameter_blocks.push_back(&scales_[k]);
      unknown.push_back(static_cast<long>(6 * poses_.size() + k));
    }
    ceres::CRSMatrix crs;
    problem_.Evaluate(evaluate, nullptr, nullptr, nullptr, &crs);
    const auto n = static_cast<long>(6 * poses_.size() + scales_.size());
    Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(crs.num_rows, n);
    for (int r = 0; r < crs.num_rows; ++r)
      for (int k = crs.rows[static_cast<std::size_t>(r)]; k < crs.rows[static_cast<std::size_t>(r) + 1]; ++k)
        jacobian(r, unknown[static_cast<std::size_t>(crs.cols[static_cast<std::size_t>(k)])]) =
            crs.values[static_cast<std::size_t>(k)];
    return jacobian.transpose() * jacobian;
  }

 private:
  static ceres::Problem::Options options() {
    ceres::Problem::Options o;
    o.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return o;
  }
  Se3Manifold manifold_;
  ceres::Problem problem_;
  std::vector<PoseParameters> poses_;
  std::vector<double> scales_;
};

/// Scores with these weights (by term) of the ordinary ones; empty: as if residuals were independent.
std::vector<TermScore> scores_at(const std::vector<SurfaceTerm>& terms, const ChainSolution& at,
                                 const std::vector<double>& weights) {
  std::vector<TermScore> scores(terms.size());
  tbb::parallel_for(std::size_t{0}, terms.size(), [&](std::size_t i) {
    const Rigid3 x = pose_of(terms[i], at.poses);
    scores[i] = terms[i].generalised ? generalised_score_of(terms[i], x) : score_of(terms[i], x);
    if (!weights.empty() && !terms[i].generalised) scores[i].weight = weights[i];
  });
  return scores;
}

double largest_move_mm(const SurfaceTerm& term, const Rigid3& before, const Rigid3& after) {
  double largest = 0.0;
  for (std::size_t i = 0; i < term.fitted.size(); i += 97)
    largest =
        std::max(largest, (before * term.fitted.points_mm[i] - after * term.fitted.points_mm[i]).norm());
  return largest;
}

Status settle(ChainProblem& problem, const std::vector<double>& weights, double still_mm,
              ChainSolution& solution) {
  for (int round = 0; round < kRounds; ++round) {
    GNATHION_CHECK_OK(associate_all(problem.terms, solution));
    const std::vector<Rigid3> before = solution.poses;
    JointProblem joint(problem, solution, scores_at(problem.terms, solution, weights));
    GNATHION_CHECK_OK(joint.solve(solution));
    double moved_mm = 0.0;
    for (const SurfaceTerm& term : problem.terms)
      moved_mm =
          std::max(moved_mm, largest_move_mm(term, pose_of(term, before), pose_of(term, solution.poses)));
    if (moved_mm < still_mm) break;
  }
  return {};
}

/// Terms of one pool share what their residuals say about their noise.
void estimate_noises(std::vector<SurfaceTerm>& terms, const std::vector<Rigid3>& poses) {
  std::map<int, std::vector<FitResiduals>> pools;
  for (const SurfaceTerm& term : terms) pools[term.noise_pool].push_back({&term.pairs, pose_of(term, poses)});
  for (const auto& [pool, fits] : pools) {
    const ResidualNoise noise = estimate_noise(fits);
    for (SurfaceTerm& term : terms)
      if (term.noise_pool == pool) term.noise = noise;
  }
}

using TermsBySurface = std::map<std::pair<const MeshQuery*, int>, std::vector<SurfaceTerm*>>;

/// Rigid terms on models (no scans), by surface and pool; pool −1: all of a surface.
TermsBySurface terms_by_surface(std::vector<SurfaceTerm>& terms, bool by_pool) {
  TermsBySurface groups;
  for (SurfaceTerm& term : terms)
    if (term.rigid && term.surface_scanner < 0)
      groups[{term.surface, by_pool ? term.noise_pool : -1}].push_back(&term);
  return groups;
}

std::vector<ShapeFit> shape_fits(const std::vector<SurfaceTerm*>& terms, const std::vector<Rigid3>& poses) {
  std::vector<ShapeFit> fits;
  for (const SurfaceTerm* term : terms) fits.push_back(shape_fit_of(*term, pose_of(*term, poses)));
  return fits;
}

/// Surfaces that by all scans of them alike are bent against their model: that looks like noise to each scan,
/// and is none.
std::map<const MeshQuery*, SharedShape> bent_surfaces(std::vector<SurfaceTerm>& terms,
                                                      const std::vector<Rigid3>& poses) {
  constexpr double kMaybe =
      2.0;  // F of 24 and 24 degrees of freedom: one in 20 by chance, which does no harm
  std::map<const MeshQuery*, SharedShape> bent;
  for (const auto& [of, group] : terms_by_surface(terms, true)) {
    if (group.size() < 2) continue;
    const SharedShape shape = shared_shape(shape_fits(group, poses), shape_modes_of(*of.first));
    if (shape.freedom > 0 && shape.ratio > std::max(kMaybe, bent[of.first].ratio)) bent[of.first] = shape;
    if (!(bent[of.first].ratio > 0.0)) bent.erase(of.first);
  }
  return bent;
}

void make_patches(std::vector<SurfaceTerm>& terms) {
  tbb::parallel_for(std::size_t{0}, terms.size(), [&](std::size_t i) {
    if (terms[i].rigid) terms[i].patches = std::make_shared<PatchModel>(terms[i].pairs, terms[i].noise);
  });
}

/// The shapes of bent surfaces, with the noise that remains beside them.
Status estimate_shapes(ChainProblem& problem, const ChainSolution& at) {
  constexpr int kShapeRounds = 2;
  // One mode alone bends a bow by five times the mean along its normals, and there are several.
  constexpr double kModeOfMean = 3.0;
  const auto bent_surface = bent_surfaces(problem.terms, at.poses);
  if (bent_surface.empty()) return {};
  for (int round = 0; round < kShapeRounds; ++round) {
    for (const auto& [of, group] : terms_by_surface(problem.terms, false)) {
      const auto bent = bent_surface.find(of.first);
      if (bent == bent_surface.end()) continue;
      auto shape = std::make_shared<BodyShape>(
          estimated_shape(shape_fits(group, at.poses), shape_modes_of(*of.first),
                          kModeOfMean * bent->second.bent_mm, group.front()->shape.get()));
      shape->ratio = bent->second.ratio;
      for (SurfaceTerm* term : group) term->shape = shape;
    }
    GNATHION_CHECK_OK(associate_all(problem.terms, at));
    estimate_noises(problem.terms, at.poses);
    make_patches(problem.terms);
  }
  return {};
}

/// Terms of one pool are generalised together, if the noise is what its model takes it for.
void choose_ways(ChainProblem& problem, const std::vector<Rigid3>& poses) {
  // χ² by its freedom: of six numbers a fit, and noise is estimated; of hundreds.
  constexpr double kContradicts = 3.0, kUnexplained = 1.2;
  // Of one fit alone: good ones of its pool do not make up for it.
  constexpr double kOneContradicts = 5.0, kOneUnexplained = 1.6;
  std::vector<Disagreement> apart(problem.terms.size());
  tbb::parallel_for(std::size_t{0}, apart.size(), [&](std::size_t i) {
    SurfaceTerm& term = problem.terms[i];
    if (!term.rigid) return;
    apart[i] = disagreement_of(term, pose_of(term, poses), problem.scale_sigmas);
  });
  std::map<int, Disagreement> pools;
  std::set<int> spoilt;
  for (std::size_t i = 0; i < apart.size(); ++i) {
    Disagreement& pool = pools[problem.terms[i].noise_pool];
    if (apart[i].chi2 > kOneContradicts * apart[i].freedom ||
        apart[i].rest_chi2 > kOneUnexplained * apart[i].rest_freedom)
      spoilt.insert(problem.terms[i].noise_pool);
    pool.chi2 += apart[i].chi2;
    pool.freedom += apart[i].freedom;
    pool.rest_chi2 += apart[i].rest_chi2;
    pool.rest_freedom += apart[i].rest_freedom;
  }
  for (SurfaceTerm& term : problem.terms) {
    const Disagreement& pool = pools[term.noise_pool];
    const double ratio = pool.freedom > 0 ? pool.chi2 / pool.freedom : 1.0;
    const double rest = pool.rest_freedom > 0 ? pool.rest_chi2 / pool.rest_freedom : 1.0;
    term.generalised = term.rigid && pool.freedom > 0 && ratio < kContradicts && rest < kUnexplained &&
                       spoilt.count(term.noise_pool) == 0;
    term.widened = std::max({1.0, ratio, rest});
  }
}

std::vector<double> weights_of(const std::vector<SurfaceTerm>& terms, const std::vector<Rigid3>& poses) {
  std::vector<double> weights(terms.size());
  tbb::parallel_for(std::size_t{0}, terms.size(), [&](std::size_t i) {
    const SurfaceTerm& term = terms[i];
    const Rigid3 x = pose_of(term, poses);
    weights[i] =
        term.generalised ? 1.0 / term.widened : score_weight(score_of(term, x), score_noise(term, x));
  });
  return weights;
}

/// M of each term.
std::vector<Eigen::MatrixXd> noises_at(const std::vector<SurfaceTerm>& terms, const ChainSolution& at,
                                       const std::vector<TermScore>& scores) {
  std::vector<Eigen::MatrixXd> noises(terms.size());
  tbb::parallel_for(std::size_t{0}, terms.size(), [&](std::size_t i) {
    if (terms[i].generalised)
      noises[i] = terms[i].widened * scores[i].information;
    else
      noises[i] = score_noise(terms[i], pose_of(terms[i], at.poses));
  });
  return noises;
}

/// Σ λ²M over all unknowns, and what the shapes of bent surfaces add: the covariance of the joint score.
Eigen::MatrixXd joint_noise(const ChainProblem& problem, const ChainSolution& at,
                            const std::vector<TermScore>& scores) {
  const std::vector<Eigen::MatrixXd> noises = noises_at(problem.terms, at, scores);
  const auto pose_rows = static_cast<long>(6 * problem.poses.size());
  const long n = pose_rows + static_cast<long>(problem.scale_sigmas.size());
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t k = 0; k < problem.scale_sigmas.size(); ++k) {
    const long row = pose_rows + static_cast<long>(k);
    sum(row, row) += 1.0 / (problem.scale_sigmas[k] * problem.scale_sigmas[k]);
  }
  for (const KnownPose& known : problem.known) {
    const long row = 6 * known.pose;
    sum.block<6, 6>(row, row) += known.covariance.ldlt().solve(Matrix6::Identity());
  }
  std::map<const BodyShape*, Eigen::MatrixXd> by_shape;  // ∂(joint score)/∂(sizes): all scans share the error
  for (std::size_t i = 0; i < problem.terms.size(); ++i) {
    const SurfaceTerm& term = problem.terms[i];
    const std::vector<int> scanners = scanners_of(term);
    Eigen::MatrixXd map = Eigen::MatrixXd::Zero(6 + static_cast<long>(scanners.size()), n);
    // X = A⁻¹B: exp(b) on B moves X by Ad_{A⁻¹}b, exp(a) on A by −Ad_{A⁻¹}a.
    const Matrix6 by_right = term.left ? adjoint(at.poses[static_cast<std::size_t>(*term.left)].inverse())
                                       : Matrix6(Matrix6::Identity());
    map.block<6, 6>(0, 6 * term.right) = by_right;
    if (term.left) map.block<6, 6>(0, 6 * *term.left) = -by_right;
    for (std::size_t k = 0; k < scanners.size(); ++k)
      map(6 + static_cast<long>(k), pose_rows + scanners[k]) = 1.0;
    sum += scores[i].weight * scores[i].weight * map.transpose() * noises[i] * map;
    if (!term.shape) continue;
    Eigen::MatrixXd& by =
        by_shape.try_emplace(term.shape.get(), Eigen::MatrixXd::Zero(n, ShapeModes::kCount)).first->second;
    by += scores[i].weight * map.transpose() * score_by_shape(term, pose_of(term, at.poses));
  }
  for (const auto& [shape, by] : by_shape) sum += by * shape->covariance_mm2 * by.transpose();
  return sum;
}

/// Inverse of the information over all that is free; the rest is zero. Errors name the term whose pose has a
/// direction without information.
Result<Eigen::MatrixXd> inverse_of(const Eigen::MatrixXd& information, const ChainProblem& problem) {
  // Lengths in mm, angles at a lever of 100 mm, scales at that of 1/100 000: all of like size.
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(information.rows());
  const auto pose_rows = static_cast<long>(6 * problem.poses.size());
  for (long r = 0; r < scale.size(); ++r) {
    const auto pose = static_cast<std::size_t>(r / 6);
    if (r < pose_rows && !problem.fixed.empty() && problem.fixed[pose]) continue;
    scale[r] = r >= pose_rows ? 1e-4 : r % 6 < 3 ? 0.01 : 1.0;
  }
  const Eigen::MatrixXd even = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(even);
  const Eigen::VectorXd& strength = solver.eigenvalues();
  Eigen::VectorXd inverse = Eigen::VectorXd::Zero(strength.size());
  for (long k = 0; k < strength.size(); ++k) {
    if (strength[k] > 1e-13 * strength[strength.size() - 1]) {
      inverse[k] = 1.0 / strength[k];
      continue;
    }
    long largest = 0;
    solver.eigenvectors().col(k).cwiseAbs().maxCoeff(&largest);
    if (scale[largest] == 0.0) continue;  // fixed
    for (const SurfaceTerm& term : problem.terms)
      if (term.right == largest / 6)
        return bad_input("cannot solve chain", term.name, "a direction of its pose is undetermined");
    return bad_input("cannot solve chain", "all poses", "a direction is undetermined");
  }
  return Eigen::MatrixXd(scale.asDiagonal() * solver.eigenvectors() * inverse.asDiagonal() *
                         solver.eigenvectors().transpose() * scale.asDiagonal());
}

void describe(SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  const Rigid3 x = pose_of(term, poses);
  term.rms_mm = weighted_rms_mm(term.pairs, x);
  std::vector<PlanePair> unseen = corrected_pairs(term, term.held_out, x);
  weigh(unseen, x, term.scale_mm);
  term.held_out_mm = weighted_rms_mm(unseen, x);
}

}  // namespace

Rigid3 pose_of(const SurfaceTerm& term, const std::vector<Rigid3>& poses) {
  const Rigid3& right = poses[static_cast<std::size_t>(term.right)];
  return term.left ? poses[static_cast<std::size_t>(*term.left)].inverse() * right : right;
}

void set_samples(SurfaceTerm& term, const SurfaceSamples& all) {
  for (std::size_t i = 0; i < all.size(); ++i)
    (i % 5 == 4 ? term.held_out : term.fitted).push_back(all.points_mm[i], all.normals[i], all.triangles[i]);
}

Result<ChainSolution> solve_poses(ChainProblem& problem) {
  constexpr double kNear_mm = 3e-3;  // near enough to see what the noise is
  ChainSolution solution;
  solution.poses = problem.poses;
  solution.scales.assign(problem.scale_sigmas.size(), 0.0);
  for (SurfaceTerm& term : problem.terms) {
    term.patches.reset();
    term.generalised = false;
    term.widened = 1.0;
    term.shape.reset();
  }
  GNATHION_CHECK_OK(settle(problem, {}, kNear_mm, solution));
  GNATHION_CHECK_OK(associate_all(problem.terms, solution));
  estimate_noises(problem.terms, solution.poses);
  make_patches(problem.terms);
  GNATHION_CHECK_OK(estimate_shapes(problem, solution));
  choose_ways(problem, solution.poses);
  const std::vector<double> weights = weights_of(problem.terms, solution.poses);
  GNATHION_CHECK_OK(settle(problem, weights, kStill_mm, solution));

  GNATHION_CHECK_OK(associate_all(problem.terms, solution));
  for (SurfaceTerm& term : problem.terms) describe(term, solution.poses);
  const std::vector<TermScore> scores = scores_at(problem.terms, solution, weights);
  JointProblem joint(problem, solution, scores);
  GNATHION_TRY(const Eigen::MatrixXd bread, inverse_of(joint.information(), problem));
  const auto pose_rows = static_cast<long>(6 * problem.poses.size());
  const Eigen::MatrixXd poses =
      (bread * joint_noise(problem, solution, scores) * bread).topLeftCorner(pose_rows, pose_rows);
  solution.covariance = 0.5 * (poses + poses.transpose());
  return solution;
}

}  // namespace gnathion
