#include "tracking/body_pose.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "tracking/planar_pose.h"
#include "tracking/projection.h"

namespace gnathion {
namespace {

using Vector8 = Eigen::Matrix<double, 8, 1>;
using Jacobian = Eigen::Matrix<double, 8, 6>;

/// One observed tag with its place on the body.
struct Sighting {
  const RigCamera* camera = nullptr;
  Rigid3 camera_from_rig;
  const BodyTag* tag = nullptr;
  const TagObservation* seen = nullptr;
  Matrix8 whitener = Matrix8::Zero();  ///< L⁻¹ of the corners' covariance L·Lᵀ
  double area_px2 = 0;
  bool used = true;
};

double area(const TagCorners& c) {
  const Eigen::Vector2d a = c[2] - c[0], b = c[3] - c[1];
  return 0.5 * std::abs(a.x() * b.y() - a.y() * b.x());
}

std::vector<Sighting> collect(const Rig& rig, const TaggedBody& body, const RigTags& tags) {
  std::map<int, const BodyTag*> by_id;
  for (const BodyTag& tag : body.tags) by_id[tag.id] = &tag;
  std::vector<Sighting> sightings;
  for (std::size_t c = 0; c < std::min(tags.size(), rig.cameras.size()); ++c) {
    for (const TagObservation& o : tags[c]) {
      const auto known = by_id.find(o.id);
      if (known == by_id.end()) continue;
      Sighting s;
      s.camera = &rig.cameras[c];
      s.camera_from_rig = rig.cameras[c].rig_from_camera.inverse();
      s.tag = known->second;
      s.seen = &o;
      const Eigen::LLT<Matrix8> llt(o.covariance_px2);
      if (llt.info() != Eigen::Success) continue;
      s.whitener = llt.matrixL().solve(Matrix8::Identity());
      s.area_px2 = area(o.corners_px);
      sightings.push_back(s);
    }
  }
  return sightings;
}

/// Observed minus projected corners, px; false when a corner lies behind the camera.
bool residual_px(const Sighting& s, const Rigid3& rig_from_body, Vector8* residual, Jacobian* jacobian) {
  for (int k = 0; k < 4; ++k) {
    const Vector3 p_rig = rig_from_body * s.tag->corners_in_body_mm[static_cast<std::size_t>(k)];
    const Vector3 p = s.camera_from_rig * p_rig;
    if (!(p.z() > 1.0)) return false;
    Eigen::Matrix<double, 2, 3> d;
    residual->segment<2>(2 * k) = s.seen->corners_px[static_cast<std::size_t>(k)] -
                                  project_with_jacobian(s.camera->model, p, jacobian ? &d : nullptr);
    if (jacobian != nullptr) {
      // exp(ξ)·p_rig ≈ p_rig + ω × p_rig + v, then into the camera.
      const Eigen::Matrix<double, 2, 3> in_rig = d * s.camera_from_rig.rotation;
      jacobian->block<2, 3>(2 * k, 0) = -in_rig * skew(p_rig);
      jacobian->block<2, 3>(2 * k, 3) = in_rig;
    }
  }
  return true;
}

double rms_px(const Sighting& s, const Rigid3& rig_from_body) {
  Vector8 r;
  if (!residual_px(s, rig_from_body, &r, nullptr)) return std::numeric_limits<double>::infinity();
  return std::sqrt(r.squaredNorm() / 8);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Refined {
  Rigid3 pose;
  Matrix6 information = Matrix6::Zero();
  double chi2 = 0, squares_px2 = 0;
  int tags = 0;
};

/// Gauss–Newton over the sightings in use. With `cauchy_px` each tag is weighed down by its RMS against that
/// scale.
std::optional<Refined> refine(const std::vector<Sighting>& sightings, const Rigid3& start, double cauchy_px,
                              int iterations) {
  Refined result;
  result.pose = start;
  for (int i = 0;; ++i) {
    Matrix6 n = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    result.chi2 = result.squares_px2 = 0;
    result.tags = 0;
    for (const Sighting& s : sightings) {
      if (!s.used) continue;
      Vector8 r;
      Jacobian j;
      if (!residual_px(s, result.pose, &r, &j)) {
        if (cauchy_px > 0) continue;
        return std::nullopt;
      }
      double weight = 1;
      if (cauchy_px > 0) weight = 1 / (1 + r.squaredNorm() / (8 * cauchy_px * cauchy_px));
      const Vector8 wr = s.whitener * r;
      const Jacobian wj = s.whitener * j;
      n += weight * wj.transpose() * wj;
      g += weight * wj.transpose() * wr;
      result.chi2 += wr.squaredNorm();
      result.squares_px2 += r.squaredNorm();
      ++result.tags;
    }
    const Eigen::LDLT<Matrix6> solver(n);
    if (result.tags == 0 || solver.info() != Eigen::Success || !solver.isPositive()) return std::nullopt;
    result.information = n;
    const Vector6 step = solver.solve(g);
    if (!step.allFinite()) return std::nullopt;
    result.pose = exp_se3(step) * result.pose;
    // Steps below a thousandth of what the corners tell no longer matter.
    if (step.dot(n * step) < 1e-8 || i + 1 >= iterations) break;
  }
  return result;
}

/// Truncated sum of squares over all sightings: what a hypothesis explains.
double cost(const std::vector<Sighting>& sightings, const Rigid3& pose) {
  constexpr double kTruncatePx = 4;
  double sum = 0;
  for (const Sighting& s : sightings) {
    const double rms = rms_px(s, pose);
    sum += std::min(rms * rms, kTruncatePx * kTruncatePx);
  }
  return sum;
}

struct Hypothesis {
  Rigid3 pose;
  double cost = 0;
};

/// Both planar solutions of the largest tags, each judged by all tags and polished under a robust loss. Best
/// first; hypotheses that end in the same minimum are merged.
std::vector<Hypothesis> hypotheses(const std::vector<Sighting>& sightings) {
  std::vector<const Sighting*> largest;
  for (const Sighting& s : sightings) largest.push_back(&s);
  std::stable_sort(largest.begin(), largest.end(),
                   [](const Sighting* a, const Sighting* b) { return a->area_px2 > b->area_px2; });
  if (largest.size() > 8) largest.resize(8);
  std::vector<Hypothesis> found;
  for (const Sighting* s : largest) {
    for (const Rigid3& camera_from_body : planar_poses(s->camera->model, *s->tag, s->seen->corners_px)) {
      const Rigid3 pose = s->camera->rig_from_camera * camera_from_body;
      found.push_back({pose, cost(sightings, pose)});
    }
  }
  const auto by_cost = [](const Hypothesis& a, const Hypothesis& b) { return a.cost < b.cost; };
  std::stable_sort(found.begin(), found.end(), by_cost);
  std::vector<Hypothesis> minima;
  for (const Hypothesis& h : found) {
    if (minima.size() >= 4) break;
    const auto wide = refine(sightings, h.pose, 2.0, 8);
    if (!wide) continue;
    const auto polished = refine(sightings, wide->pose, 0.5, 8);
    if (!polished) continue;
    const bool known = std::any_of(minima.begin(), minima.end(), [&](const Hypothesis& m) {
      return (m.pose.inverse() * polished->pose).angle_rad() < 0.02;
    });
    if (!known) minima.push_back({polished->pose, cost(sightings, polished->pose)});
  }
  std::stable_sort(minima.begin(), minima.end(), by_cost);
  return minima;
}

/// Takes out tags that disagree with the others, refining in between.
std::optional<Refined> refine_without_outliers(std::vector<Sighting>& sightings, const Rigid3& start,
                                               const BodyPoseOptions& options) {
  Rigid3 pose = start;
  std::optional<Refined> refined;
  for (int round = 0; round < 4; ++round) {
    std::vector<double> rms;
    for (const Sighting& s : sightings) rms.push_back(rms_px(s, pose));
    std::vector<double> finite;
    for (double r : rms) finite.push_back(std::min(r, 1e6));
    const double limit = std::max(options.outlier_min_px, options.outlier_factor * median(finite));
    bool changed = round == 0;
    for (std::size_t i = 0; i < sightings.size(); ++i) {
      const bool use = rms[i] <= limit;
      changed = changed || use != sightings[i].used;
      sightings[i].used = use;
    }
    if (!changed) break;
    refined = refine(sightings, pose, 0, 10);
    if (!refined) return std::nullopt;
    pose = refined->pose;
  }
  return refined;
}

std::string tags_text(int n) {
  return n == 1 ? "1 tag" : fmt::format("{} tags", n);
}

int distinct_tags(const std::vector<Sighting>& sightings) {
  std::vector<int> ids;
  for (const Sighting& s : sightings) {
    if (s.used) ids.push_back(s.seen->id);
  }
  std::sort(ids.begin(), ids.end());
  return static_cast<int>(std::unique(ids.begin(), ids.end()) - ids.begin());
}

/// Where to start from: the guess when it explains the tags, else the best hypothesis. The reason when
/// neither.
std::optional<Rigid3> starting_pose(const std::vector<Sighting>& sightings, const BodyPoseOptions& options,
                                    const std::optional<Rigid3>& guess, std::string* reason) {
  if (guess) {
    const auto robust = refine(sightings, *guess, 1.0, 6);
    if (robust) {
      std::vector<double> rms;
      for (const Sighting& s : sightings) rms.push_back(rms_px(s, robust->pose));
      if (median(rms) <= options.max_rms_px) return robust->pose;
    }
  }
  const std::vector<Hypothesis> found = hypotheses(sightings);
  if (found.empty()) {
    *reason = "no pose fits the tags";
    return std::nullopt;
  }
  const double noise = 0.05 * 0.05 * static_cast<double>(sightings.size());
  if (found.size() > 1 && found[1].cost < options.ambiguity_ratio * found[0].cost + noise) {
    *reason = fmt::format("two poses fit the tags, {:.0f} deg apart",
                          (found[0].pose.inverse() * found[1].pose).angle_rad() * 180 / M_PI);
    return std::nullopt;
  }
  return found[0].pose;
}

}  // namespace

BodyPose estimate_body_pose(const Rig& rig, const TaggedBody& body, const RigTags& tags,
                            const BodyPoseOptions& options, const std::optional<Rigid3>& guess) {
  BodyPose result;
  std::vector<Sighting> sightings = collect(rig, body, tags);
  result.tags_seen = static_cast<int>(sightings.size());
  if (sightings.empty()) {
    result.reason = "no tag seen";
    return result;
  }
  if (distinct_tags(sightings) < options.min_tags) {
    result.reason = fmt::format("{}, need {}", tags_text(distinct_tags(sightings)), options.min_tags);
    return result;
  }
  const auto start = starting_pose(sightings, options, guess, &result.reason);
  if (!start) return result;
  const auto refined = refine_without_outliers(sightings, *start, options);
  if (!refined) {
    result.reason = "the pose did not converge";
    return result;
  }
  result.camera_from_body = refined->pose;
  result.tags_used = refined->tags;
  for (const Sighting& s : sightings) {
    if (!s.used) result.rejected_ids.push_back(s.seen->id);
  }
  const double coordinates = 8.0 * refined->tags;
  result.rms_px = std::sqrt(refined->squares_px2 / coordinates);
  // The level of the residuals, drawn a little to 1 where there are few: χ² with 4 coordinates' worth of
  // belief.
  const double variance = (refined->chi2 + 4) / (coordinates - 6 + 4);
  result.residual_scale = std::sqrt(variance);
  result.covariance = variance * refined->information.inverse();
  const int kept = distinct_tags(sightings);
  if (kept < options.min_tags) {
    result.reason =
        fmt::format("only {} of {} agree, need {}", kept, tags_text(result.tags_seen), options.min_tags);
  } else if (2 * refined->tags < result.tags_seen) {
    result.reason =
        fmt::format("{} of {} disagree", result.tags_seen - refined->tags, tags_text(result.tags_seen));
  } else if (result.rms_px > options.max_rms_px) {
    result.reason = fmt::format("residual {:.1f} px", result.rms_px);
  } else {
    result.valid = true;
  }
  return result;
}

std::optional<TagCorners> projected_tag(const RigCamera& camera, const BodyTag& tag,
                                        const Rigid3& rig_from_body, double max_tilt_deg) {
  const Rigid3 camera_from_body = camera.rig_from_camera.inverse() * rig_from_body;
  std::array<Vector3, 4> p;
  TagCorners corners;
  for (std::size_t k = 0; k < 4; ++k) {
    p[k] = camera_from_body * tag.corners_in_body_mm[k];
    if (!(p[k].z() > 1.0)) return std::nullopt;
    corners[k] = project_with_jacobian(camera.model, p[k], nullptr);
    const bool inside = corners[k].x() > 2 && corners[k].y() > 2 &&
                        corners[k].x() < camera.model.width_px - 3 &&
                        corners[k].y() < camera.model.height_px - 3;
    if (!inside) return std::nullopt;
  }
  // Lower left, lower right, upper left span the print; its normal points to the viewer.
  const Vector3 normal = (p[1] - p[0]).cross(p[3] - p[0]).normalized();
  const Vector3 centre = 0.25 * (p[0] + p[1] + p[2] + p[3]);
  if (-normal.dot(centre.normalized()) < std::cos(max_tilt_deg * M_PI / 180)) return std::nullopt;
  return corners;
}

}  // namespace gnathion
