#include "tracking/body_pose.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/LU>

#include "tracking/body_fit.h"
#include "tracking/planar_pose.h"
#include "tracking/projection.h"

namespace gnathion {
namespace {

const Vector6 kStill = Vector6::Zero();

/// Truncated sum of squares over all sightings: what a hypothesis explains.
double cost(const std::vector<Sighting>& sightings, const Rigid3& pose) {
  constexpr double kTruncatePx = 4;
  double sum = 0;
  for (const Sighting& s : sightings) {
    const double rms = rms_px(s, pose, kStill);
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
std::vector<Hypothesis> hypotheses(std::vector<Sighting>& sightings) {
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
    const auto wide = fit_body(sightings, h.pose, kStill, Loss::kCauchyWide, 8);
    if (!wide) continue;
    const auto polished = fit_body(sightings, wide->pose, kStill, Loss::kCauchy, 8);
    if (!polished) continue;
    const bool known = std::any_of(minima.begin(), minima.end(), [&](const Hypothesis& m) {
      return (m.pose.inverse() * polished->pose).angle_rad() < 0.02;
    });
    if (!known) minima.push_back({polished->pose, cost(sightings, polished->pose)});
  }
  std::stable_sort(minima.begin(), minima.end(), by_cost);
  return minima;
}

/// Fits, takes out tags that disagree with the others, and fits again.
std::optional<BodyFit> fit_without_outliers(std::vector<Sighting>& sightings, const Rigid3& start,
                                            const Vector6& velocity, const BodyPoseOptions& options) {
  Rigid3 pose = start;
  std::optional<BodyFit> fit;
  std::vector<double> rms(sightings.size());
  for (int round = 0; round < 4; ++round) {
    for (std::size_t i = 0; i < sightings.size(); ++i)
      rms[i] = std::min(rms_px(sightings[i], pose, velocity), 1e6);
    const double limit = std::max(options.outlier_min_px, options.outlier_factor * median(rms));
    bool changed = round == 0;
    for (std::size_t i = 0; i < sightings.size(); ++i) {
      const bool use = rms[i] <= limit;
      changed = changed || use != sightings[i].used;
      sightings[i].used = use;
    }
    if (!changed) break;
    fit = fit_body(sightings, pose, velocity, Loss::kBounded, 10);
    if (!fit) return std::nullopt;
    pose = fit->pose;
  }
  return fit;
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
std::optional<Rigid3> starting_pose(std::vector<Sighting>& sightings, const BodyPoseOptions& options,
                                    const std::optional<Rigid3>& guess, const Vector6& velocity,
                                    std::string* reason) {
  if (guess) {
    const auto robust = fit_body(sightings, *guess, velocity, Loss::kCauchy, 6);
    if (robust) {
      std::vector<double> rms;
      for (const Sighting& s : sightings) rms.push_back(rms_px(s, robust->pose, velocity));
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
    const auto turn = [](const Rigid3& a, const Rigid3& b) { return (a.inverse() * b).angle_rad(); };
    const double apart = turn(found[0].pose, found[1].pose);
    // The past decides where it is clearly on one side.
    for (std::size_t i = 0; guess && i < 2; ++i) {
      if (turn(*guess, found[i].pose) < 0.25 * apart) return found[i].pose;
    }
    *reason = fmt::format("two poses fit the tags, {:.0f} deg apart", apart * 180 / M_PI);
    return std::nullopt;
  }
  return found[0].pose;
}

/// What a rolling shutter adds to the covariance when the body's velocity is not known: jaws and heads move
/// at about 100 mm/s and 1 rad/s about the body at most.
Matrix6 unknown_velocity(const std::vector<Sighting>& sightings, const Rigid3& pose) {
  constexpr double kSpeedMmS = 50, kTurnRadS = 0.5;
  double square_s2 = 0, count = 0;
  for (const Sighting& s : sightings) {
    if (!s.used) continue;
    square_s2 += s.after_capture_s.squaredNorm();
    count += 4;
  }
  Vector6 sigma;
  sigma << Vector3::Constant(kTurnRadS), Vector3::Constant(kSpeedMmS);
  const Matrix6 ad = adjoint(Rigid3::from_translation(pose.translation_mm));  // turns about the body
  return square_s2 / std::max(count, 1.0) * ad * Matrix6(sigma.cwiseAbs2().asDiagonal()) * ad.transpose();
}

}  // namespace

BodyPose estimate_body_pose(const Rig& rig, const TaggedBody& body, const RigTags& tags,
                            const BodyPoseOptions& options, const std::optional<Rigid3>& guess,
                            const std::optional<Vector6>& velocity) {
  BodyPose result;
  std::vector<Sighting> sightings = sightings_of(rig, body, tags);
  result.tags_seen = static_cast<int>(sightings.size());
  if (sightings.empty()) {
    result.reason = "no tag seen";
    return result;
  }
  if (distinct_tags(sightings) < options.min_tags) {
    result.reason = fmt::format("{}, need {}", tags_text(distinct_tags(sightings)), options.min_tags);
    return result;
  }
  const Vector6 moving = velocity.value_or(kStill);
  const auto start = starting_pose(sightings, options, guess, moving, &result.reason);
  if (!start) return result;
  const auto fit = fit_without_outliers(sightings, *start, moving, options);
  if (!fit) {
    result.reason = "the pose did not converge";
    return result;
  }
  result.camera_from_body = fit->pose;
  result.tags_used = fit->tags;
  for (const Sighting& s : sightings) {
    if (!s.used) result.rejected_ids.push_back(s.seen->id);
  }
  result.rms_px = std::sqrt(fit->squares_px2 / (8.0 * fit->tags));
  // The level of the residuals, drawn a little to 1 where there are few: χ² with 4 coordinates' worth of
  // belief.
  const double variance = (fit->chi2 + 4) / (std::max(8 * fit->weight, 8.0) - 6 + 4);
  result.residual_scale = std::sqrt(variance);
  result.covariance = variance * fit->information.inverse();
  const bool rolling = std::any_of(sightings.begin(), sightings.end(),
                                   [](const Sighting& s) { return !s.after_capture_s.isZero(); });
  if (rolling && !velocity) result.covariance += unknown_velocity(sightings, fit->pose);
  result.focal_length.resize(rig.cameras.size());
  add_scale_evidence(sightings, *fit, moving, &result);
  const int kept = distinct_tags(sightings);
  if (kept < options.min_tags) {
    result.reason =
        fmt::format("only {} of {} agree, need {}", kept, tags_text(result.tags_seen), options.min_tags);
  } else if (2 * fit->tags < result.tags_seen) {
    result.reason =
        fmt::format("{} of {} disagree", result.tags_seen - fit->tags, tags_text(result.tags_seen));
  } else if (result.rms_px > options.max_rms_px) {
    result.reason = fmt::format("residual {:.1f} px", result.rms_px);
  } else {
    result.valid = true;
  }
  return result;
}

double after_capture_s(const RigCamera& camera, double row_px) {
  const double line_s = 1e-9 * camera.line_time_ns.value_or(0);
  return line_s * (row_px - 0.5 * (camera.model.height_px - 1));
}

std::optional<TagCorners> projected_tag(const RigCamera& camera, const BodyTag& tag,
                                        const Rigid3& rig_from_body, double max_tilt_deg,
                                        const Vector6& velocity) {
  const Rigid3 camera_from_rig = camera.rig_from_camera.inverse();
  std::array<Vector3, 4> p;
  TagCorners corners;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector3 p_rig = rig_from_body * tag.corners_in_body_mm[k];
    p[k] = camera_from_rig * p_rig;
    if (!(p[k].z() > 1.0)) return std::nullopt;
    corners[k] = project_with_jacobian(camera.model, p[k], nullptr);
    if (const double after_s = after_capture_s(camera, corners[k].y()); after_s != 0) {
      p[k] = camera_from_rig * moved_point(p_rig, velocity, after_s);
      if (!(p[k].z() > 1.0)) return std::nullopt;
      corners[k] = project_with_jacobian(camera.model, p[k], nullptr);
    }
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
