#include "registration/pair_features.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "registration/point_grid.h"

namespace gnathion {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kRollBins = 24;             // of the angle about the reference point's normal
constexpr std::uint32_t kCrowded = 3000;  // bins with more pairs tell nothing and cost most
constexpr int kPeaksPerReference = 3;

double angle_between(const Vector3& a, const Vector3& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0));
}

/// Quantised pair features; the number of bins makes keys dense.
class PairKeys {
 public:
  explicit PairKeys(const PairVotingOptions& o)
      : o_(o),
        distance_bins_(static_cast<std::uint32_t>(std::ceil(o.max_distance_mm / o.distance_bin_mm))),
        angle_bins_(static_cast<std::uint32_t>(std::ceil(180.0 / o.angle_bin_deg))) {}

  std::uint32_t count() const { return distance_bins_ * angle_bins_ * angle_bins_ * angle_bins_; }

  /// False where the pair is too short or too long, or lies in one plane and so says nothing.
  bool key(const Vector3& p1, const Vector3& n1, const Vector3& p2, const Vector3& n2,
           std::uint32_t* out) const {
    const Vector3 d = p2 - p1;
    const double length = d.norm();
    if (length < o_.min_distance_mm || length >= o_.max_distance_mm) return false;
    const Vector3 u = d / length;
    const double a = angle_between(n1, u), b = angle_between(n2, u), c = angle_between(n1, n2);
    const double flat = o_.angle_bin_deg * kPi / 180.0;
    if (c < flat && std::abs(a - kPi / 2) < flat) return false;
    const auto bin = [&](double angle) {
      return std::min(static_cast<std::uint32_t>(angle / kPi * angle_bins_), angle_bins_ - 1);
    };
    const auto distance = static_cast<std::uint32_t>(length / o_.distance_bin_mm);
    *out = ((std::min(distance, distance_bins_ - 1) * angle_bins_ + bin(a)) * angle_bins_ + bin(b)) *
               angle_bins_ +
           bin(c);
    return true;
  }

 private:
  PairVotingOptions o_;
  std::uint32_t distance_bins_, angle_bins_;
};

/// The frame with the point at its origin and the normal along x.
Rigid3 reference_frame(const Vector3& p, const Vector3& n) {
  const Matrix3 r = Eigen::Quaterniond::FromTwoVectors(n, Vector3::UnitX()).toRotationMatrix();
  return {r, -(r * p)};
}

double roll_of(const Vector3& in_reference_frame) {
  return std::atan2(in_reference_frame.z(), in_reference_frame.y());
}

/// Model pairs by key: where each key's entries begin, then (reference, roll) of each.
struct PairTable {
  struct Entry {
    std::uint32_t reference;
    float roll;
  };
  std::vector<std::uint32_t> start;
  std::vector<Entry> entries;
};

PairTable build_table(const SurfaceSamples& model, const std::vector<Rigid3>& frames, const PairKeys& keys) {
  PairTable table;
  table.start.assign(keys.count() + 1, 0);
  const auto for_each_pair = [&](auto&& f) {
    for (std::uint32_t i = 0; i < model.size(); ++i) {
      for (std::uint32_t k = 0; k < model.size(); ++k) {
        std::uint32_t key = 0;
        if (i != k &&
            keys.key(model.points_mm[i], model.normals[i], model.points_mm[k], model.normals[k], &key)) {
          f(key, i, k);
        }
      }
    }
  };
  for_each_pair([&](std::uint32_t key, std::uint32_t, std::uint32_t) { ++table.start[key + 1]; });
  std::partial_sum(table.start.begin(), table.start.end(), table.start.begin());
  table.entries.resize(table.start.back());
  std::vector<std::uint32_t> next(table.start.begin(), table.start.end() - 1);
  for_each_pair([&](std::uint32_t key, std::uint32_t i, std::uint32_t k) {
    table.entries[next[key]++] = {i, static_cast<float>(roll_of(frames[i] * model.points_mm[k]))};
  });
  return table;
}

/// All votes of one scene point; its best few (model point, roll) become hypotheses.
std::vector<PoseHypothesis> votes_of(std::uint32_t reference, const SurfaceSamples& scene,
                                     const PointGrid& grid, const std::vector<Rigid3>& model_frames,
                                     const PairTable& table, const PairKeys& keys, double max_distance_mm) {
  std::vector<float> votes(model_frames.size() * kRollBins, 0.0F);
  const Vector3& p = scene.points_mm[reference];
  const Vector3& n = scene.normals[reference];
  const Rigid3 frame = reference_frame(p, n);
  grid.for_each_within(p, max_distance_mm, [&](std::uint32_t k, double) {
    std::uint32_t key = 0;
    if (k == reference || !keys.key(p, n, scene.points_mm[k], scene.normals[k], &key)) return;
    const std::uint32_t begin = table.start[key], end = table.start[key + 1];
    if (begin == end || end - begin > kCrowded) return;
    const double roll = roll_of(frame * scene.points_mm[k]);
    const float weight = 1.0F / std::sqrt(static_cast<float>(end - begin));
    for (std::uint32_t e = begin; e < end; ++e) {
      double turn = (roll - static_cast<double>(table.entries[e].roll)) / (2.0 * kPi);
      turn -= std::floor(turn);
      const int bin = static_cast<int>(turn * kRollBins + 0.5) % kRollBins;
      votes[static_cast<std::size_t>(table.entries[e].reference) * kRollBins + bin] += weight;
    }
  });

  std::vector<PoseHypothesis> best;
  for (int peak = 0; peak < kPeaksPerReference; ++peak) {
    const auto top = std::max_element(votes.begin(), votes.end());
    if (!(*top > 0.0F) || (peak > 0 && *top < 0.6 * best.front().votes)) break;
    const auto index = static_cast<std::size_t>(top - votes.begin());
    const double roll = 2.0 * kPi * static_cast<double>(index % kRollBins) / kRollBins;
    const Rigid3 turn = Rigid3::about_axis(Vector3::Zero(), Vector3::UnitX(), roll);
    best.push_back({frame.inverse() * turn * model_frames[index / kRollBins], *top});
    *top = 0.0F;
  }
  return best;
}

/// Poses that move the model's points alike become one, with the sum of their votes.
std::vector<PoseHypothesis> merged_hypotheses(std::vector<PoseHypothesis> all, const SurfaceSamples& model,
                                              double near_mm, double near_deg, std::size_t limit) {
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.votes > b.votes; });
  Vector3 centre = Vector3::Zero();
  for (const Vector3& p : model.points_mm) centre += p / static_cast<double>(model.size());
  const double near_trace = 1.0 + 2.0 * std::cos(near_deg * kPi / 180.0);
  std::vector<PoseHypothesis> merged;
  std::vector<Vector3> centres;
  for (const PoseHypothesis& h : all) {
    const Vector3 c = h.scene_from_model * centre;
    bool found = false;
    for (std::size_t i = 0; i < merged.size() && !found; ++i) {
      if ((centres[i] - c).norm() > near_mm) continue;
      const double trace =
          merged[i].scene_from_model.rotation.cwiseProduct(h.scene_from_model.rotation).sum();
      if (trace < near_trace) continue;
      merged[i].votes += h.votes;
      found = true;
    }
    if (found) continue;
    merged.push_back(h);
    centres.push_back(c);
  }
  std::stable_sort(merged.begin(), merged.end(),
                   [](const auto& a, const auto& b) { return a.votes > b.votes; });
  if (merged.size() > limit) merged.resize(limit);
  return merged;
}

}  // namespace

std::vector<PoseHypothesis> vote_poses(const SurfaceSamples& model, const SurfaceSamples& scene,
                                       const PairVotingOptions& options) {
  const PairKeys keys(options);
  std::vector<Rigid3> frames;
  for (std::size_t i = 0; i < model.size(); ++i) {
    frames.push_back(reference_frame(model.points_mm[i], model.normals[i]));
  }
  const PairTable table = build_table(model, frames, keys);
  const PointGrid grid(scene.points_mm, 0.25 * options.max_distance_mm);
  // Scene samples are in no spatial order (see thinned), so the first ones are spread over the whole surface.
  const std::size_t references = std::min(options.scene_references, scene.size());
  std::vector<std::vector<PoseHypothesis>> found(references);
  tbb::parallel_for(std::size_t{0}, references, [&](std::size_t i) {
    found[i] =
        votes_of(static_cast<std::uint32_t>(i), scene, grid, frames, table, keys, options.max_distance_mm);
  });
  std::vector<PoseHypothesis> all;
  for (const auto& f : found) all.insert(all.end(), f.begin(), f.end());
  return merged_hypotheses(std::move(all), model, 2.0 * options.distance_bin_mm, 1.5 * options.angle_bin_deg,
                           options.max_hypotheses);
}

}  // namespace gnathion
