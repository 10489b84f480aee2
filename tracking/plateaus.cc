#include "tracking/plateaus.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include "core/angle.h"
#include "tracking/rests.h"
#include "tracking/se3_mean.h"

namespace gnathion {
namespace {

const char* const kCannotFindPositions = "cannot find MI and TP";

/// Sample covariance drawn toward the shape that the single frames' own covariances give, scaled to the level
/// seen: a sample of few frames has too little to tell all 21 numbers.
Matrix6 steadied(const Matrix6& sample, const Matrix6& predicted, double frames) {
  constexpr double kBelief = 20;  // frames' worth
  const Eigen::LDLT<Matrix6> solver(predicted);
  if (solver.info() != Eigen::Success || !solver.isPositive()) return sample;
  const double level = (solver.solve(sample)).trace() / 6;
  return (frames * sample + kBelief * level * predicted) / (frames + kBelief);
}

/// The floor as a covariance in the head frame: `mm` about the bow's reference point, `deg` about any axis.
Matrix6 floor_covariance(const PlateauOptions& options, const Vector3& point_in_head_mm) {
  Matrix6 at_point = Matrix6::Zero();
  at_point.topLeftCorner<3, 3>() = Matrix3::Identity() * std::pow(options.floor_deg * kRadPerDeg, 2);
  at_point.bottomRightCorner<3, 3>() = Matrix3::Identity() * std::pow(options.floor_mm, 2);
  const Matrix6 ad = adjoint(Rigid3::from_translation(point_in_head_mm));
  return ad * at_point * ad.transpose();
}

Transform<Camera, HeadFrame> mean_head(const std::vector<const MotionRow*>& rows) {
  std::vector<Rigid3> heads;
  for (const MotionRow* row : rows) heads.push_back(row->head.camera_from_body);
  return Transform<Camera, HeadFrame>(robust_mean(heads).mean);
}

void tell_dispersion(const std::vector<const MotionRow*>& rows, const PlateauOptions& options,
                     Plateau* plateau) {
  double squares_mm2 = 0, squares_rad2 = 0;
  std::vector<double> distances_mm;
  const Rigid3& mean = plateau->head_from_bow.value.rigid;
  for (const MotionRow* row : rows) {
    const Rigid3 pose = row->head_from_bow().rigid;
    distances_mm.push_back((pose * options.point_in_bow_mm - mean * options.point_in_bow_mm).norm());
    squares_mm2 += distances_mm.back() * distances_mm.back();
    squares_rad2 += std::pow((mean.inverse() * pose).angle_rad(), 2);
  }
  const auto middle = distances_mm.begin() + static_cast<std::ptrdiff_t>(distances_mm.size() / 2);
  std::nth_element(distances_mm.begin(), middle, distances_mm.end());
  plateau->typical_mm = *middle;
  const double n = static_cast<double>(rows.size());
  plateau->dispersion_mm = std::sqrt(squares_mm2 / n);
  plateau->dispersion_deg = std::sqrt(squares_rad2 / n) / kRadPerDeg;
}

/// Presses and releases of one kind of mark, as intervals; a mark never released ends with the session.
std::vector<PlateauOptions::Interval> pedal_intervals(const SessionMotion& session, const std::string& kind) {
  std::vector<PlateauOptions::Interval> intervals;
  bool down = false;
  const double end_s = session.rows.empty() ? 0 : session.time_s(session.rows.back());
  for (const EventSample& e : session.events) {
    if (e.kind != kind || e.pressed == down) continue;
    const double at = e.header.capture.seconds_since(session.start);
    if (e.pressed) {
      intervals.emplace_back(at, end_s);
    } else {
      intervals.back().second = at;
    }
    down = e.pressed;
  }
  return intervals;
}

Result<std::vector<Plateau>> marked(const SessionMotion& session,
                                    const std::vector<PlateauOptions::Interval>& intervals,
                                    const char* source, const char* name, const PlateauOptions& options,
                                    std::vector<std::string>* notes) {
  std::vector<Plateau> plateaus;
  Error last;
  for (const auto& [start, end] : intervals) {
    const double trim = std::min(options.trim_s, 0.2 * (end - start));
    auto plateau = plateau_between(session, start + trim, end - trim, options);
    if (plateau) {
      plateau->source = source;
      plateaus.push_back(std::move(*plateau));
    } else {
      last = plateau.error();
      notes->push_back(fmt::format("{} at {:.2f}..{:.2f} s left out: {}", name, start, end, last.why));
    }
  }
  if (plateaus.empty() && !intervals.empty())
    return in_context(fmt::format("{} ({})", kCannotFindPositions, name), last);
  return plateaus;
}

/// Given intervals, else pedal marks; empty where there are neither.
Result<std::vector<Plateau>> marks(const SessionMotion& session,
                                   const std::vector<PlateauOptions::Interval>& given, const char* name,
                                   const PlateauOptions& options, std::vector<std::string>* notes) {
  if (!given.empty()) return marked(session, given, "given", name, options, notes);
  return marked(session, pedal_intervals(session, name), "pedal", name, options, notes);
}

/// Information-weighted mean of rests of one position, its covariance widened where they disagree (Birge
/// ratio).
Uncertain<Transform<HeadFrame, Bow>> combined(const std::vector<Plateau>& plateaus) {
  Uncertain<Transform<HeadFrame, Bow>> mean = plateaus.front().head_from_bow;
  if (plateaus.size() == 1) return mean;
  double chi2 = 0;
  for (int i = 0; i < 5; ++i) {
    Matrix6 n = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    chi2 = 0;
    for (const Plateau& p : plateaus) {
      const Matrix6 information = p.head_from_bow.covariance.inverse();
      const Vector6 xi = difference(p.head_from_bow.value.rigid, mean.value.rigid);
      n += information;
      g += information * xi;
      chi2 += xi.dot(information * xi);
    }
    mean.covariance = n.inverse();
    mean.value.rigid = exp_se3(mean.covariance * g) * mean.value.rigid;
  }
  mean.covariance *= std::max(1.0, chi2 / (6.0 * static_cast<double>(plateaus.size() - 1)));
  return mean;
}

Closure closure_of(const JawPositions& positions, std::size_t second, const PlateauOptions& options) {
  const auto& a = positions.mi.front().head_from_bow;
  const auto& b = positions.mi[second].head_from_bow;
  Closure c;
  c.second = second;
  const Vector6 xi = difference(b.value.rigid, a.value.rigid);
  const Matrix6 cov = a.covariance + b.covariance;  // the difference is small: Ad is the identity
  const Vector3 point = a.value * options.point_in_bow_mm, moved = b.value * options.point_in_bow_mm;
  c.distance_mm = (moved - point).norm();
  c.sigma_mm = std::sqrt(point_covariance(cov, point).trace());
  c.angle_deg = xi.head<3>().norm() / kRadPerDeg;
  c.sigma_deg = std::sqrt(cov.topLeftCorner<3, 3>().trace()) / kRadPerDeg;
  c.sigmas = std::sqrt(xi.dot(cov.ldlt().solve(xi)) / 6);
  return c;
}

/// Best first by what each says of its mean; the order of time stays.
void rank(std::vector<Plateau>* plateaus) {
  std::vector<Plateau*> order;
  for (Plateau& p : *plateaus) order.push_back(&p);
  std::stable_sort(order.begin(), order.end(),
                   [](const Plateau* a, const Plateau* b) { return a->sigma_mm < b->sigma_mm; });
  for (std::size_t i = 0; i < order.size(); ++i) order[i]->rank = static_cast<int>(i) + 1;
}

/// The combined MI, and whether its rests close.
void finish_mi(const PlateauOptions& options, JawPositions* p) {
  rank(&p->mi);
  p->head_from_bow_mi = combined(p->mi);
  const Plateau& first = p->mi.front();
  p->at_mi = {first.camera_from_head * p->head_from_bow_mi.value, first.camera_from_head};
  for (std::size_t i = 1; i < p->mi.size(); ++i) {
    p->closures.push_back(closure_of(*p, i, options));
    const Closure& c = p->closures.back();
    if (c.consistent()) continue;
    p->notes.push_back(
        fmt::format("MI at {:.1f} s is {:.3f} mm and {:.3f} deg off the first: bow or head frame slipped, "
                    "or the bite differs",
                    p->mi[i].start_s, c.distance_mm, c.angle_deg));
  }
}

/// T_B and what goes with it, from the plateaus.
void finish(const PlateauOptions& options, JawPositions* p) {
  finish_mi(options, p);
  rank(&p->tp);
  p->head_from_bow_tp = combined(p->tp);
  const Plateau& tp = p->tp.front();
  p->at_tp = {tp.camera_from_head * p->head_from_bow_tp.value, tp.camera_from_head};
  p->bow_motion.value = relative_motion(p->at_mi, p->at_tp);
  // T_B = H0·R1·R0⁻¹·H0⁻¹ with R1 = exp(ξ1)R̂1, R0 = exp(ξ0)R̂0: ξ_B = Ad_H0 (ξ1 − Ad_{R1 R0⁻¹} ξ0).
  const Rigid3 in_head = p->head_from_bow_tp.value.rigid * p->head_from_bow_mi.value.rigid.inverse();
  const Matrix6 ad = adjoint(in_head), ad_head = adjoint(p->at_mi.f_from_head.rigid);
  const Matrix6 cov = p->head_from_bow_tp.covariance + ad * p->head_from_bow_mi.covariance * ad.transpose();
  p->bow_motion.covariance = ad_head * cov * ad_head.transpose();
}

}  // namespace

bool JawPositions::closes() const {
  return std::all_of(closures.begin(), closures.end(), [](const Closure& c) { return c.consistent(); });
}

Result<Plateau> plateau_between(const SessionMotion& session, double start_s, double end_s,
                                const PlateauOptions& options) {
  std::vector<const MotionRow*> rows;
  int all = 0;
  std::string reason;
  for (const MotionRow& row : session.rows) {
    const double t = session.time_s(row);
    if (t < start_s || t > end_s) continue;
    ++all;
    if (row.valid()) {
      rows.push_back(&row);
    } else {
      reason = row.reason();
    }
  }
  if (static_cast<int>(rows.size()) < options.min_frames) {
    return bad_input("cannot average the interval", fmt::format("{:.2f}..{:.2f} s", start_s, end_s),
                     fmt::format("{} of its {} frames are valid, need {}{}", rows.size(), all,
                                 options.min_frames, reason.empty() ? "" : " (" + reason + ")"));
  }
  std::vector<Rigid3> relative;
  Matrix6 predicted = Matrix6::Zero();
  for (const MotionRow* row : rows) {
    relative.push_back(row->head_from_bow().rigid);
    predicted += row->head_from_bow_covariance() / static_cast<double>(rows.size());
  }
  const PoseMean mean = robust_mean(relative);
  Plateau plateau;
  plateau.start_s = start_s;
  plateau.end_s = end_s;
  plateau.source = "given";
  plateau.frames = static_cast<int>(rows.size());
  plateau.frames_used = mean.used;
  plateau.effective_frames = mean.effective_count;
  plateau.head_from_bow.value = Transform<HeadFrame, Bow>(mean.mean);
  plateau.head_from_bow.covariance =
      steadied(mean.sample_covariance, predicted, mean.used) / mean.effective_count +
      floor_covariance(options, mean.mean * options.point_in_bow_mm);
  plateau.camera_from_head = mean_head(rows);
  plateau.sigma_mm = std::sqrt(
      point_covariance(plateau.head_from_bow.covariance, mean.mean * options.point_in_bow_mm).trace());
  tell_dispersion(rows, options, &plateau);
  return plateau;
}

Result<JawPositions> find_jaw_positions(const SessionMotion& session, const PlateauOptions& options) {
  JawPositions positions;
  GNATHION_TRY(positions.mi, marks(session, options.mi_s, "MI", options, &positions.notes));
  GNATHION_TRY(positions.tp, marks(session, options.tp_s, "TP", options, &positions.notes));
  if (positions.mi.empty() || positions.tp.empty()) {
    const std::vector<Plateau> rests = find_rests(session, options);
    GNATHION_CHECK_OK(label_mi(rests, options, &positions));
    GNATHION_CHECK_OK(label_tp(rests, options, &positions));
  }
  finish(options, &positions);
  return positions;
}

Result<JawPositions> find_mi(const SessionMotion& session, const PlateauOptions& options) {
  JawPositions positions;
  GNATHION_TRY(positions.mi, marks(session, options.mi_s, "MI", options, &positions.notes));
  if (positions.mi.empty()) {
    GNATHION_CHECK_OK(label_mi(find_rests(session, options), options, &positions));
  }
  finish_mi(options, &positions);
  return positions;
}

}  // namespace gnathion
