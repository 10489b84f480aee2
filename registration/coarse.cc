#include "registration/coarse.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "registration/pair_features.h"
#include "registration/point_grid.h"
#include "registration/robust_icp.h"

namespace gnathion {
namespace {

constexpr std::size_t kModelPoints = 600;  // pairs grow with its square
constexpr std::size_t kVerified = 300;     // hypotheses that are verified on samples
constexpr std::size_t kTried = 16;         // of which these meet the true surface, with few points
constexpr std::size_t kTryPoints = 300;
constexpr std::size_t kRefined = 5;  // and these with many
constexpr std::size_t kRefinePoints = 1200;
constexpr double kHopeless = 0.5;  // of the best one's support: far below what clear_margin asks

struct Scored {
  Rigid3 target_from_source;
  double score = 0.0;
};

double median_distance(const SurfaceSamples& s) {
  Vector3 centre = Vector3::Zero();
  for (const Vector3& p : s.points_mm) centre += p / static_cast<double>(s.size());
  std::vector<double> d;
  for (const Vector3& p : s.points_mm) d.push_back((p - centre).norm());
  std::nth_element(d.begin(), d.begin() + static_cast<std::ptrdiff_t>(d.size() / 2), d.end());
  return d[d.size() / 2];
}

/// The target as a bag of oriented points, for fast verification.
struct TargetCloud {
  SurfaceSamples samples;
  PointGrid grid;
  double reach_mm;
  TargetCloud(SurfaceSamples s, double reach)
      : samples(std::move(s)), grid(samples.points_mm, reach), reach_mm(reach) {}
};

std::vector<PlanePair> cloud_pairs(const SurfaceSamples& source, const TargetCloud& target, const Rigid3& x) {
  std::vector<PlanePair> pairs;
  for (std::size_t i = 0; i < source.size(); ++i) {
    const Vector3 p = x * source.points_mm[i];
    const long k = target.grid.nearest(p, target.reach_mm);
    if (k < 0) continue;
    const Vector3& normal = target.samples.normals[static_cast<std::size_t>(k)];
    if (normal.dot(x.rotation * source.normals[i]) < 0.7) continue;
    pairs.push_back({source.points_mm[i], target.samples.points_mm[static_cast<std::size_t>(k)], normal,
                     static_cast<std::uint32_t>(i), 1.0});
  }
  return pairs;
}

/// Fraction of the source near the target's planes, soft-edged.
double support_of(const std::vector<PlanePair>& pairs, const Rigid3& x, std::size_t total,
                  double tolerance_mm) {
  double sum = 0.0;
  for (const PlanePair& p : pairs) {
    const double u = p.residual_mm(x) / tolerance_mm;
    sum += std::max(0.0, 1.0 - u * u);
  }
  return total > 0 ? sum / static_cast<double>(total) : 0.0;
}

/// A few damped Gauss–Newton steps on the target's samples.
Rigid3 settled_on_cloud(const SurfaceSamples& source, const TargetCloud& target, Rigid3 x,
                        double tolerance_mm) {
  for (int i = 0; i < 6; ++i) {
    std::vector<PlanePair> pairs = cloud_pairs(source, target, x);
    if (pairs.size() < 12) break;
    weigh(pairs, x, tolerance_mm / 2.0);
    x = plane_step(pairs, x);
  }
  return x;
}

bool distinct(const Rigid3& a, const Rigid3& b, const SurfaceSamples& source, double near_mm) {
  double sum = 0.0;
  for (const Vector3& p : source.points_mm) sum += (a * p - b * p).squaredNorm();
  return std::sqrt(sum / static_cast<double>(source.size())) > near_mm;
}

/// Best first, without near repeats.
std::vector<Scored> ranked(std::vector<Scored> all, const SurfaceSamples& source, double near_mm,
                           std::size_t limit) {
  std::stable_sort(all.begin(), all.end(),
                   [](const Scored& a, const Scored& b) { return a.score > b.score; });
  std::vector<Scored> kept;
  for (const Scored& s : all) {
    if (kept.size() == limit) break;
    const bool fresh = std::all_of(kept.begin(), kept.end(), [&](const Scored& k) {
      return distinct(k.target_from_source, s.target_from_source, source, near_mm);
    });
    if (fresh) kept.push_back(s);
  }
  return kept;
}

}  // namespace

Result<CoarseMatch> find_pose(const SearchSurface& source, const SearchSurface& target,
                              const MeshQuery& target_query, const CoarseOptions& options) {
  const auto undetermined = [&](const std::string& why) {
    return bad_input("cannot align", options.name, "undetermined: " + why);
  };
  const double area = kept_area_mm2(*source.mesh, source.keep);
  const double target_area = kept_area_mm2(*target.mesh, target.keep);
  if (!(area > 0.0) || !(target_area > 0.0)) return undetermined("no surface to align");

  // Even samples of both surfaces, as dense as the source's area allows.
  const double spacing = std::sqrt(area / static_cast<double>(kModelPoints));
  const auto sampled = [&](const SearchSurface& s, double surface_area, double step) {
    const auto dense = static_cast<std::size_t>(10.0 * surface_area / (step * step));
    return thinned(sample_surface(*s.mesh, s.keep, dense, options.seed), step, 0.7 * spacing);
  };
  const SurfaceSamples model = sampled(source, area, 1.15 * spacing);
  const SurfaceSamples scene = sampled(target, target_area, 1.15 * spacing);
  const TargetCloud cloud(sampled(target, target_area, 0.6 * spacing), 1.2 * spacing);
  if (model.size() < 30 || scene.size() < 30) return undetermined("too little surface");

  // Votes for poses.
  PairVotingOptions voting;
  voting.distance_bin_mm = spacing;
  voting.min_distance_mm = 2.0 * spacing;
  voting.max_distance_mm =
      options.feature_reach_mm > 0.0 ? options.feature_reach_mm : 1.6 * median_distance(model);
  voting.scene_references = std::max<std::size_t>(250, scene.size() / 4);
  voting.max_hypotheses = kVerified;
  const std::vector<PoseHypothesis> hypotheses = vote_poses(model, scene, voting);

  // Verified on samples, then the best few on the true surface.
  const double tolerance = 0.6 * spacing + 2.0 * options.noise_mm;
  std::vector<Scored> scored(hypotheses.size());
  tbb::parallel_for(std::size_t{0}, hypotheses.size(), [&](std::size_t i) {
    const Rigid3 x = settled_on_cloud(model, cloud, hypotheses[i].scene_from_model, tolerance);
    scored[i] = {x, support_of(cloud_pairs(model, cloud, x), x, model.size(), 0.5 * tolerance)};
  });
  scored = ranked(std::move(scored), model, 1.5 * spacing, kTried);

  const double fine_tolerance = std::max(4.0 * options.noise_mm, 0.12 * spacing);
  const auto refine = [&](std::size_t points, int iterations, double score_tolerance) {
    const SurfaceSamples fine = sample_surface(*source.mesh, source.keep, points, options.seed + 1);
    IcpOptions icp;
    icp.first_gate_mm = 1.5 * spacing;
    icp.last_gate_mm = std::max(0.5 * spacing, 8.0 * options.noise_mm);
    icp.noise_mm = std::max(options.noise_mm, 0.02 * spacing);
    icp.settled_mm = 0.01 * spacing;
    icp.max_iterations = iterations;
    for (Scored& s : scored) {
      const IcpResult refined = robust_icp(fine, target_query, target.keep, s.target_from_source, icp);
      s = {refined.target_from_source,
           support_of(refined.pairs, refined.target_from_source, fine.size(), score_tolerance)};
    }
    scored = ranked(std::move(scored), model, spacing, kRefined);
  };
  refine(kTryPoints, 10, 2.0 * fine_tolerance);
  // Many points cost most. A pose with half the support of the best will not come near it.
  while (scored.size() > 1 && scored.back().score < kHopeless * scored.front().score) scored.pop_back();
  refine(kRefinePoints, 25, fine_tolerance);

  if (scored.empty() || scored[0].score < 0.5 * options.overlap) {
    return undetermined(
        fmt::format("at best {:.0f} % of the surface finds a counterpart, {:.0f} % are needed",
                    scored.empty() ? 0.0 : 100.0 * scored[0].score, 50.0 * options.overlap));
  }
  const double second = scored.size() > 1 ? scored[1].score : 0.0;
  if (scored[0].score < options.clear_margin * second) {
    return undetermined(fmt::format("two distinct poses explain {:.0f} % and {:.0f} % of the surface",
                                    100.0 * scored[0].score, 100.0 * second));
  }
  return CoarseMatch{scored[0].target_from_source, scored[0].score, second};
}

}  // namespace gnathion
