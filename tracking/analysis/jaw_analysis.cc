#include "tracking/analysis/jaw_analysis.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>

#include "core/angle.h"
#include "core/random.h"
#include "tracking/analysis/jaw_scene.h"

namespace gnathion {
namespace {

const char* const kCannotAnalyse = "cannot analyse the jaw's motion";

/// Matrix square root for drawing; covariances may be singular or zero.
Matrix6 root(const Matrix6& covariance) {
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(0.5 * (covariance + covariance.transpose()));
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
}

Vector6 normal6(Random& random) {
  Vector6 v;
  for (int i = 0; i < 6; ++i) v[i] = random.normal();
  return v;
}

double median(std::vector<double> v) {
  if (v.empty()) return 0;
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

double median_step(const JawRecording& r) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < r.time_s.size(); ++i) steps.push_back(r.time_s[i] - r.time_s[i - 1]);
  return median(steps);
}

/// How much more the rows scatter than their covariances say, at the incisal point. Fourth differences leave
/// the movement out: their variance is 70 times that of one row.
double scatter_ratio(const JawRecording& r, const Vector3& point_in_bow_mm) {
  std::vector<double> seen[3], stated;
  const double step = median_step(r);
  for (std::size_t i = 4; i < r.time_s.size(); ++i) {
    if (std::abs(r.time_s[i] - r.time_s[i - 4] - 4 * step) > 0.4 * step) continue;
    const auto p = [&](std::size_t back) -> Vector3 { return r.head_from_bow[i - back] * point_in_bow_mm; };
    const Vector3 d = p(4) - 4 * p(3) + 6 * p(2) - 4 * p(1) + p(0);
    for (int k = 0; k < 3; ++k) seen[k].push_back(std::abs(d[k]));
    stated.push_back(point_covariance(r.covariance[i], p(0)).trace());
  }
  if (stated.size() < 30) return 1;
  double variance = 0;
  for (const auto& axis : seen) variance += std::pow(median(axis) / 0.6745, 2) / 70;
  const double told = median(stated);
  return told > 0 ? std::sqrt(variance / told) : variance > 1e-12 ? 1e9 : 1;
}

constexpr double kWidenBeyond = 1.3;  // times the scatter that rows tell: below, it may be chance

/// Rows' covariances, widened where the rows scatter more than they say, with a note.
std::vector<Matrix6> honest_covariances(const JawRecording& r, const Vector3& incisal_mm,
                                        JawAnalysis* analysis) {
  const Vector3 point = r.bow_from_dental.value * incisal_mm;
  const double ratio = scatter_ratio(r, point);
  std::vector<Matrix6> covariances = r.covariance;
  if (ratio <= kWidenBeyond) return covariances;
  if (ratio < 1e6) {
    for (Matrix6& c : covariances) c *= ratio * ratio;
    analysis->notes.push_back(
        fmt::format("rows scatter {:.1f} times as much as their covariances say: these are widened", ratio));
    return covariances;
  }
  // No covariance at all is known (a table without sigma).
  analysis->notes.push_back("rows have no covariance: none of the errors holds the tracker's part");
  return covariances;
}

/// The rows' covariances as those of the mandible's motion in the dental frame: exp(ξ)R gives exp(Ad ξ)X.
std::vector<Matrix6> in_dental(const JawRecording& r, const std::vector<Matrix6>& rows) {
  const Matrix6 ad = adjoint((r.mi.value.rigid * r.bow_from_dental.value.rigid).inverse());
  std::vector<Matrix6> told;
  for (const Matrix6& c : rows) told.push_back(ad * c * ad.transpose());
  return told;
}

/// Rows of the opening limb of an opening movement, from MI up to the arc's end.
HingeArc arc_of(const JawScene& scene, const std::vector<Matrix6>& covariance, const JawSegment& s,
                double arc_deg) {
  HingeArc arc;
  const auto [first, last] = scene.rows(s.start_s, s.turn_s);
  for (std::size_t i = first; i <= last; ++i) {
    const double angle = log_so3(scene.mandible[i].rotation).dot(scene.landmarks.plane.left);
    if (angle > arc_deg * kRadPerDeg) break;
    if (angle < 0.5 * kRadPerDeg) continue;
    arc.motions.push_back(scene.mandible[i]);
    arc.covariance.push_back(covariance[i]);
  }
  return arc;
}

struct HingeChoice {
  std::optional<HingeAxis> hinge;
  std::vector<const JawSegment*> arcs;
  std::string reason;
};

bool stays(const HingeAxis& h, const JawAnalysisOptions& options) {
  return h.migration_mm <= std::max(options.hinge_migration_mm, 3 * h.migration_sigma_mm) &&
         3 * h.migration_sigma_mm < 10;
}

HingeArc joined(const JawScene& scene, const std::vector<Matrix6>& covariance,
                const std::vector<const JawSegment*>& arcs, double arc_deg) {
  HingeArc all;
  for (const JawSegment* s : arcs) {
    const HingeArc one = arc_of(scene, covariance, *s, arc_deg);
    all.motions.insert(all.motions.end(), one.motions.begin(), one.motions.end());
    all.covariance.insert(all.covariance.end(), one.covariance.begin(), one.covariance.end());
  }
  return all;
}

/// One axis over all opening arcs that turn about an axis which stays.
HingeChoice choose_hinge(const JawScene& scene, const std::vector<Matrix6>& covariance,
                         const std::vector<JawSegment>& segments, const JawAnalysisOptions& options) {
  HingeChoice choice;
  double least_migration = 1e300;
  int openings = 0;
  const auto fit = [&](const HingeArc& arc) {
    return fit_hinge_axis(arc, scene.landmarks.incisal_mm, scene.landmarks.plane.left);
  };
  for (const JawSegment& s : segments) {
    if (s.movement != JawMovement::kOpening) continue;
    ++openings;
    const auto hinge = fit(arc_of(scene, covariance, s, options.hinge_arc_deg));
    if (!hinge) continue;
    least_migration = std::min(least_migration, hinge->migration_mm);
    if (stays(*hinge, options)) choice.arcs.push_back(&s);
  }
  if (openings == 0) {
    choice.reason = "no opening movement in the recording";
  } else if (least_migration > 1e200) {
    choice.reason = "no opening has 8 rows and 4 deg of rotation before it leaves the hinge arc";
  } else if (choice.arcs.empty()) {
    choice.reason = fmt::format(
        "the axis migrates by {:.1f} mm within the first {:g} deg: a free opening, in which the condyles "
        "slide, not a "
        "terminal hinge movement; record one guided by the hand",
        least_migration, options.hinge_arc_deg);
  } else {
    choice.hinge = fit(joined(scene, covariance, choice.arcs, options.hinge_arc_deg));
    if (!choice.hinge) choice.reason = "the fit to the opening arcs did not converge";
    if (choice.hinge) {
      choice.hinge->start_s = choice.arcs.front()->start_s;
      choice.hinge->end_s = choice.arcs.back()->turn_s;
    }
  }
  return choice;
}

/// The instantaneous centre of an opening lies behind the teeth near the joints, whatever the condyles slide.
Status check_axis(const JawScene& scene, const std::vector<Matrix6>& covariance,
                  const std::vector<JawSegment>& segments) {
  const JawSegment* opening = largest_of(scene, segments, JawMovement::kOpening);
  if (opening == nullptr) return {};
  const ReferencePlane& plane = scene.landmarks.plane;
  const auto axis =
      fit_hinge_axis(arc_of(scene, covariance, *opening, 12), scene.landmarks.incisal_mm, plane.left, false);
  if (!axis) return {};
  const Vector3 d = axis->point_mm - scene.landmarks.incisal_mm;
  const double behind = -plane.forward(d), above = -plane.downward(d),
               along = plane.leftward(axis->direction);
  if (behind >= 35 && behind <= 160 && std::abs(above) <= 100 && along >= 0.85) return {};
  return bad_input(
      kCannotAnalyse, "opening",
      fmt::format("the jaw seems to turn about an axis {:.0f} mm behind and {:.0f} mm above the incisal "
                  "point, {:.0f} deg off the transverse direction, which no jaw does: the chain is "
                  "another bow's, the landmarks are another patient's, or the poses are not in mm",
                  behind, above, std::acos(std::clamp(along, -1.0, 1.0)) / kRadPerDeg));
}

Status check_motion(const JawScene& scene) {
  const ReferencePlane& plane = scene.landmarks.plane;
  double away = 0, down = 0, up = 0, turn = 0;
  for (std::size_t i = 0; i < scene.mandible.size(); ++i) {
    const Vector3 d = scene.displacement(scene.landmarks.incisal_mm, i);
    away = std::max(away, d.norm());
    down = std::max(down, plane.downward(d));
    up = std::max(up, -plane.downward(d));
    turn = std::max(turn, scene.mandible[i].angle_rad());
  }
  if (away < 2)
    return bad_input(
        kCannotAnalyse, "motion",
        fmt::format("the incisal point never leaves MI by more than {:.3f} mm ({:.2f} deg): one static "
                    "pose, or not millimetres",
                    away, turn / kRadPerDeg));
  if (away > 100)
    return bad_input(
        kCannotAnalyse, "motion",
        fmt::format("the incisal point moves by {:.0f} mm, no jaw opens so far: landmarks far from the "
                    "jaw, a chain of another bow, or not millimetres",
                    away));
  if (up > 5 && up > down)
    return bad_input(
        kCannotAnalyse, "motion",
        fmt::format("the incisal point moves {:.1f} mm towards the maxilla and {:.1f} mm away from it: "
                    "the reference plane is upside down, or the chain is another bow's",
                    up, down));
  return {};
}

void put_condyles(const HingeAxis& hinge, JawLandmarks* l) {
  l->condyle_left_mm = hinge.point_mm + 0.5 * l->intercondylar_mm * hinge.direction;
  l->condyle_right_mm = hinge.point_mm - 0.5 * l->intercondylar_mm * hinge.direction;
}

/// Draws of all that is uncertain: every row, MI, T_D and the landmarks.
class Draws {
 public:
  Draws(const JawRecording& recording, const std::vector<Matrix6>& covariance,
        const JawAnalysisOptions& options)
      : recording_(recording),
        random_(options.seed, 0x6a61776d),
        mi_(root(recording.mi.covariance)),
        t_d_(root(recording.bow_from_dental.covariance)) {
    for (const Matrix6& c : covariance) rows_.push_back(root(c));
  }

  JawScene next(const JawScene& nominal, const JawLandmarks& given) {
    JawScene scene = nominal;
    const Rigid3 mi = exp_se3(mi_ * normal6(random_)) * recording_.mi.value.rigid;
    const Rigid3 t_d = exp_se3(t_d_ * normal6(random_)) * recording_.bow_from_dental.value.rigid;
    const Rigid3 left = (mi * t_d).inverse();
    for (std::size_t i = 0; i < rows_.size(); ++i)
      scene.mandible[i] = left * exp_se3(rows_[i] * normal6(random_)) * recording_.head_from_bow[i] * t_d;
    JawLandmarks& l = scene.landmarks = given;
    for (Vector3* tooth : {&l.incisal_mm, &l.molar_left_mm, &l.molar_right_mm})
      *tooth += l.sigma_mm * random_.normal3();
    for (auto* condyle : {&l.condyle_left_mm, &l.condyle_right_mm}) {
      const Vector3 error = l.condyle_sigma_mm * random_.normal3();
      if (*condyle) **condyle += error;
    }
    return scene;
  }

 private:
  const JawRecording& recording_;
  Random random_;
  Matrix6 mi_, t_d_;
  std::vector<Matrix6> rows_;
};

/// Standard deviations from draws. A number that most draws do not have is not determined after all.
void add_sigmas(const JawRecording& recording, const std::vector<Matrix6>& rows,
                const std::vector<Matrix6>& covariance, const JawScene& nominal, const JawLandmarks& given,
                const HingeChoice& choice, const JawAnalysisOptions& options, JawAnalysis* analysis) {
  Draws draws(recording, rows, options);
  const double scatter = scatter_ratio(recording, recording.bow_from_dental.value * given.incisal_mm);
  const double seen = scatter > kWidenBeyond ? 1.0 : scatter;  // of what `rows` say
  const std::size_t count = analysis->numbers.size();
  std::vector<double> n(count, 0), sum(count, 0), squares(count, 0);
  for (int i = 0; i < options.draws; ++i) {
    JawScene scene = draws.next(nominal, given);
    std::optional<HingeAxis> hinge;
    if (choice.hinge)
      hinge = fit_hinge_axis(joined(scene, covariance, choice.arcs, options.hinge_arc_deg),
                             scene.landmarks.incisal_mm, scene.landmarks.plane.left, false);
    if (!scene.has_condyles() && hinge) put_condyles(*hinge, &scene.landmarks);
    const auto drawn = jaw_numbers(scene, analysis->segments, hinge, {}, options);
    for (std::size_t k = 0; k < count; ++k) {
      if (!drawn[k].determined || !analysis->numbers[k].determined) continue;
      const double d = drawn[k].value - analysis->numbers[k].value;
      n[k] += 1, sum[k] += d, squares[k] += d * d;
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    JawNumber& number = analysis->numbers[k];
    if (!number.determined) continue;
    if (n[k] < 0.8 * options.draws || n[k] < 2) {
      number.determined = false;
      number.reason =
          fmt::format("within its error it is not reached: {:.0f} of {} draws have it", n[k], options.draws);
      continue;
    }
    number.sigma = std::sqrt(std::max(0.0, (squares[k] - sum[k] * sum[k] / n[k]) / (n[k] - 1)));
    // SIMEX (Cook & Stefanski 1994): a draw's noise comes on top of the recording's. An outline's surplus is
    // proportional to sigma, which a draw makes sqrt(r² + 1) times what is told and the recording has r
    // times; taken back to none. One recording's own noise leaves that correction uncertain by half of
    // itself.
    if (number.grows_with_noise) {
      const double surplus = sum[k] / n[k] * seen / (std::sqrt(seen * seen + 1.0) - seen);
      number.value = std::max(0.0, number.value - surplus);
      number.sigma = std::hypot(number.sigma, 0.5 * surplus);
    }
  }
}

void tell_opening_pattern(JawAnalysis* a) {
  // DC/TMD: a straight opening stays within 2 mm of the midline.
  constexpr double kMidline_mm = 2;
  const JawNumber *deflection = a->find("opening_deflection"), *deviation = a->find("opening_deviation");
  if (deflection == nullptr || !deflection->determined) return;
  const auto side = [](double v) { return v > 0 ? "left" : "right"; };
  if (std::abs(deflection->value) >= kMidline_mm) {
    a->opening_pattern = fmt::format("deflection to the {}", side(deflection->value));
  } else if (std::abs(deviation->value) >= kMidline_mm) {
    a->opening_pattern = fmt::format("corrected deviation to the {}", side(deviation->value));
  } else {
    a->opening_pattern = "straight";
  }
}

void tell_chewing_side(JawAnalysis* a) {
  std::size_t left = 0, right = 0;
  for (const ChewingCycle& c : a->cycles) left += c.side == "left", right += c.side == "right";
  if (a->cycles.empty()) return;
  a->chewing_side = 3 * left >= 2 * a->cycles.size()    ? "left"
                    : 3 * right >= 2 * a->cycles.size() ? "right"
                                                        : "both";
}

}  // namespace

const JawNumber* JawAnalysis::find(const std::string& name, const std::string& side) const {
  for (const JawNumber& n : numbers)
    if (n.name == name && n.side == side) return &n;
  return nullptr;
}

Result<JawAnalysis> analyse_jaw_motion(const JawRecording& recording, const JawLandmarks& landmarks,
                                       const JawAnalysisOptions& options) {
  GNATHION_CHECK_OK(check_landmarks(landmarks));
  JawAnalysis analysis;
  JawScene scene;
  scene.time_s = &recording.time_s;
  scene.mandible = recording.mandible();
  scene.landmarks = landmarks;
  scene.half_window_s = options.half_window_s;
  scene.gap_s = std::max(0.06, 3.5 * median_step(recording));  // three lost frames in a row are bridged
  GNATHION_CHECK_OK(check_motion(scene));
  const std::vector<Matrix6> rows = honest_covariances(recording, landmarks.incisal_mm, &analysis);
  const std::vector<Matrix6> covariance = in_dental(recording, rows);
  analysis.segments = find_segments(recording.time_s, scene.mandible, landmarks, options.segments);
  GNATHION_CHECK_OK(check_axis(scene, covariance, analysis.segments));
  const HingeChoice choice = choose_hinge(scene, covariance, analysis.segments, options);
  analysis.hinge = choice.hinge;
  analysis.hinge_reason = choice.reason;
  analysis.condyles_from = scene.has_condyles() ? "landmarks" : choice.hinge ? "hinge axis" : "";
  if (!scene.has_condyles() && choice.hinge) put_condyles(*choice.hinge, &scene.landmarks);
  analysis.landmarks = scene.landmarks;
  analysis.numbers = jaw_numbers(scene, analysis.segments, choice.hinge, choice.reason, options);
  analysis.cycles = chewing_cycles(scene, analysis.segments);
  add_sigmas(recording, rows, covariance, scene, landmarks, choice, options, &analysis);
  tell_opening_pattern(&analysis);
  tell_chewing_side(&analysis);
  return analysis;
}

}  // namespace gnathion
