#include "calibration/chain.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <set>

#include "calibration/chain_derived.h"
#include "calibration/chain_registrations.h"
#include "calibration/composition.h"
#include "calibration/pose_conditioning.h"
#include "core/angle.h"

namespace gnathion {
namespace {

using StateJacobian = Eigen::Matrix<double, 6 * kChainStates, Eigen::Dynamic>;

/// The estimated poses that the chain reports, and how they depend on the problem's unknowns.
struct Reported {
  std::vector<Rigid3> poses;  ///< in the order of ChainState
  StateJacobian jacobian;
};

Reported reported_poses(const ChainUnknowns& u, const std::vector<Rigid3>& x) {
  Reported r;
  r.jacobian = StateJacobian::Zero(6 * kChainStates, 6 * static_cast<long>(x.size()));
  const auto at = [&](int unknown) -> const Rigid3& { return x[static_cast<std::size_t>(unknown)]; };
  r.jacobian.block<6, 6>(0, 6 * u.t_d).setIdentity();
  r.poses.push_back(at(u.t_d));
  if (u.first_face_mi < 0) return r;
  // X = A⁻¹B: exp(b) on B moves X by Ad_{A⁻¹}b, exp(a) on A by −Ad_{A⁻¹}a.
  const auto add = [&](ChainState state, int a, int b) {
    const Matrix6 by_b = adjoint(at(a).inverse());
    const int row = 6 * static_cast<int>(state);
    r.jacobian.block<6, 6>(row, 6 * b) += by_b;
    r.jacobian.block<6, 6>(row, 6 * a) -= by_b;
    r.poses.push_back(at(a).inverse() * at(b));
  };
  add(ChainState::kBowFromFace, u.head_from_bow_mi, u.first_face_mi);
  add(ChainState::kBowFromFaceTp, u.head_from_bow_tp, u.first_face_tp);
  add(ChainState::kFaceMiFromFaceTp, u.first_face_mi, u.first_face_tp);
  return r;
}

bool begins_with(const std::string& text, const char* start) {
  return text.rfind(start, 0) == 0;
}

/// A pose of the chain: what it is worth by its covariance, and how well the registrations that it leans on
/// fit.
ChainPose pose_from(const Rigid3& value, const Matrix6& covariance, const BodyAxes& body,
                    const std::vector<SurfaceTerm>& terms, const std::vector<const char*>& leans_on) {
  ChainPose pose;
  pose.value = value;
  pose.covariance = 0.5 * (covariance + covariance.transpose());
  const PoseConditioning c = pose_conditioning(pose.covariance, body);
  pose.condition = c.condition;
  pose.weak = c.weak;
  double sum = 0.0, held_out = 0.0, count = 0.0;
  for (const SurfaceTerm& term : terms) {
    const bool used = std::any_of(leans_on.begin(), leans_on.end(),
                                  [&](const char* name) { return begins_with(term.name, name); });
    if (!used) continue;
    sum += term.rms_mm * term.rms_mm;
    held_out += term.held_out_mm * term.held_out_mm;
    count += 1.0;
  }
  if (count > 0.0) {
    pose.rms_mm = std::sqrt(sum / count);
    pose.held_out_mm = std::sqrt(held_out / count);
  }
  return pose;
}

/// The solution in the chain's own terms.
Chain assembled(const ChainScans& scans, const ChainUnknowns& unknowns, const ChainSolution& solution,
                const std::vector<SurfaceTerm>& terms) {
  Chain chain;
  chain.has_faces = unknowns.first_face_mi >= 0;
  const Reported reported = reported_poses(unknowns, solution.poses);
  chain.joint = reported.jacobian * solution.covariance * reported.jacobian.transpose();
  const BodyAxes bow = body_axes("the bow", scans.bow_model);
  const auto own = [&](ChainState state, const BodyAxes& body, const std::vector<const char*>& leans_on) {
    const int k = static_cast<int>(state);
    return pose_from(reported.poses[static_cast<std::size_t>(k)], chain.joint.block<6, 6>(6 * k, 6 * k), body,
                     terms, leans_on);
  };
  chain.bow_from_dental = own(ChainState::kBowFromDental, bow, {"clutch scan"});
  if (!chain.has_faces) return chain;
  const std::vector<const char*> head = {"head"};
  chain.bow_from_face =
      own(ChainState::kBowFromFace, bow, {"bow in face scan in MI", "bow in face scan 1 in MI"});
  chain.bow_from_face_tp = own(ChainState::kBowFromFaceTp, bow, {"bow in face scan in TP"});
  const BodyAxes face = body_axes("the face", scans.faces_mi.front());
  chain.face_mi_from_face_tp = own(ChainState::kFaceMiFromFaceTp, face, head);
  const auto derived = [&](const ChainDerived& d, const BodyAxes& body,
                           const std::vector<const char*>& leans_on) {
    return pose_from(d.value, d.jacobian * chain.joint * d.jacobian.transpose(), body, terms, leans_on);
  };
  chain.dental_from_face = derived(dental_from_face_of(chain), body_axes("the lower arch", scans.mandible_mi),
                                   {"clutch scan", "bow in face scan in MI"});
  chain.bow_motion =
      derived(bow_motion_of(chain), moved(chain.bow_from_face.value.inverse(), bow), {"bow in", "head"});
  return chain;
}

/// Some vertices of the lower arch.
std::vector<Vector3> some_teeth_mm(const TriangleMesh& mandible) {
  constexpr std::size_t kTeeth = 500;
  std::vector<Vector3> teeth_mm;
  const std::size_t step = mandible.vertices_mm.size() / kTeeth + 1;
  for (std::size_t v = 0; v < mandible.vertices_mm.size(); v += step)
    teeth_mm.push_back(mandible.vertices_mm[v]);
  return teeth_mm;
}

/// Says how fine the face scans are, and whether that is fine enough.
void judge_face_scans(const std::vector<SurfaceTerm>& terms, const TriangleMesh& mandible, Chain& chain) {
  std::vector<Vector3> teeth_in_bow_mm = some_teeth_mm(mandible);
  for (Vector3& p : teeth_in_bow_mm) p = chain.bow_from_dental.value * p;
  const auto judge = [&](const std::string& name, const ChainPose& bow_from_face, FaceScanQuality& quality) {
    for (const SurfaceTerm& term : terms)
      if (term.name == "bow in " + name)
        quality = face_scan_quality(term.noise, bow_from_face.covariance, teeth_in_bow_mm);
    if (const auto warning = too_coarse(name, quality)) chain.warnings.push_back(*warning);
  };
  judge("face scan in MI", chain.bow_from_face, chain.face_mi);
  judge("face scan in TP", chain.bow_from_face_tp, chain.face_tp);
}

/// Registrations whose surfaces differ by more than a scanner's noise does.
void judge_surfaces(const std::vector<SurfaceTerm>& terms, Chain& chain) {
  constexpr double kWorthTelling = 3.0;
  constexpr double kSure = 3.5;  // F of 24 and 24 degrees of freedom: one in 600 by chance
  std::set<const BodyShape*> told;
  for (const SurfaceTerm& term : terms)
    if (term.shape && term.shape->ratio > kSure && told.insert(term.shape.get()).second)
      chain.warnings.push_back(fmt::format(
          "{}: all scans agree that the body is not as its model, by about {:.2f} mm (bent? printed to "
          "another scale?); its shape was estimated along, a scan of the printed body as its model "
          "would be surer",
          term.name, term.shape->bent_mm));
  for (const SurfaceTerm& term : terms)
    if (term.rigid && term.widened > kWorthTelling)
      chain.warnings.push_back(
          fmt::format("{}: the surfaces differ by more than noise explains (bent, blurred or another body?): "
                      "its variance "
                      "is told {:.1f} times as large",
                      term.name, term.widened));
}

Status check_units(const TriangleMesh& mesh, const std::string& name, double least_mm, double most_mm) {
  if (mesh.empty()) return bad_input("cannot solve chain", name, "missing or empty");
  const double size = bounding_box(mesh).size_mm().maxCoeff();
  if (size >= least_mm && size <= most_mm) return {};
  const char* unit = size < 1.0        ? " (metres?)"
                     : size < least_mm ? " (centimetres?)"
                     : size > 10000    ? " (micrometres?)"
                                       : "";
  return bad_input(
      "cannot solve chain", name,
      fmt::format("{:.4g} mm large; {:.0f} to {:.0f} mm expected{}", size, least_mm, most_mm, unit));
}

Status check_scans(const ChainScans& scans, const ChainOptions& options) {
  GNATHION_CHECK_OK(check_units(scans.mandible_mi, "mandible in MI", 25, 150));
  if (scans.clutch_scans.empty())
    return bad_input("cannot solve chain", "clutch scan", "missing: it gives T_D");
  for (const TriangleMesh& scan : scans.clutch_scans)
    GNATHION_CHECK_OK(check_units(scan, "clutch scan", 25, 200));
  GNATHION_CHECK_OK(check_units(scans.bow_model, "bow model", 25, 500));
  if (scans.faces_mi.empty() != scans.faces_tp.empty())
    return bad_input("cannot solve chain", scans.faces_mi.empty() ? "face scan in MI" : "face scan in TP",
                     "missing: T_B needs the bow in both positions");
  if (scans.faces_mi.empty() && options.tracked)
    return bad_input("cannot solve chain", "tracked positions",
                     "no face scans to solve them with; 'transform motion' takes them as they are");
  for (const TriangleMesh& scan : scans.faces_mi)
    GNATHION_CHECK_OK(check_units(scan, "face scan in MI", 80, 800));
  for (const TriangleMesh& scan : scans.faces_tp)
    GNATHION_CHECK_OK(check_units(scan, "face scan in TP", 80, 800));
  if (scans.head_frame_model.empty()) return {};
  return check_units(scans.head_frame_model, "head frame model", 25, 500);
}

std::vector<std::string> missing_parts(const ChainScans& scans, const ChainOptions& options) {
  std::vector<std::string> missing;
  if (scans.faces_mi.empty()) {
    missing.push_back(
        "face scans in MI and TP: T_F, T and T_B are unknown (the camera route needs none of them)");
    return missing;
  }
  if (scans.head_frame_model.empty())
    missing.push_back("head frame model: the head between the face scans is found by the face alone");
  if (!options.tracked) missing.push_back("tracked positions: T_B leans on the face scans alone");
  return missing;
}

/// T_th by the tracker's positions against that by the scans: whether the jaw was in the same TP.
TrackedAgreement compare_therapeutic(const Chain& by_scans, const TrackedPositions& tracked,
                                     const std::vector<Vector3>& teeth_mm) {
  const RouteComparison c = compare_routes(
      therapeutic_from_camera(by_scans.bow_from_dental, tracked.head_from_bow_mi, tracked.head_from_bow_tp),
      therapeutic_from_faces(by_scans), by_scans.bow_from_dental.covariance, teeth_mm);
  TrackedAgreement agreement;
  agreement.therapeutic_mm = c.largest_mm;
  agreement.therapeutic_deg = c.angle_deg;
  agreement.p_value = c.chi2_p_value;
  return agreement;
}

/// The bow in the head frame at MI: whether tracker and CAD surface mean the same frame by it. T_th does not
/// feel an error that is the same in MI and in TP.
void compare_head_frame(const ChainUnknowns& unknowns, const ChainSolution& by_scans, const Rigid3& t_d,
                        const TrackedPositions& tracked, const std::vector<Vector3>& teeth_mm,
                        TrackedAgreement& agreement) {
  const Rigid3& scanned = by_scans.poses[static_cast<std::size_t>(unknowns.head_from_bow_mi)];
  const Rigid3& seen = tracked.head_from_bow_mi.value.rigid;
  const int row = 6 * unknowns.head_from_bow_mi;
  const Matrix6 covariance = by_scans.covariance.block<6, 6>(row, row) + tracked.head_from_bow_mi.covariance;
  const Vector6 xi = difference(seen, scanned);
  agreement.head_from_bow_deg = (seen * scanned.inverse()).angle_rad() * kDegPerRad;
  agreement.head_from_bow_p_value = chi2_6_survival(xi.dot(covariance.ldlt().solve(xi)));
  double largest_mm = 0.0;
  for (const Vector3& p : teeth_mm)
    largest_mm = std::max(largest_mm, (seen * (t_d * p) - scanned * (t_d * p)).norm());
  agreement.head_from_bow_mm = largest_mm;
}

/// The scans alone are solved first: positions that contradict them would bend every pose a little, and
/// nothing in the result would say so.
Result<TrackedAgreement> agreement_with_scans(const ChainScans& scans, const TrackedPositions& tracked,
                                              ChainStart& start) {
  constexpr double kLeastP = 0.003;
  ChainProblem& problem = start.problem;
  const ChainUnknowns& u = start.unknowns;
  const auto known = std::move(problem.known);
  const bool has_frame = !scans.head_frame_model.empty();
  problem.known.clear();
  const auto head = static_cast<std::size_t>(u.first_face_mi);
  problem.fixed[head] = !has_frame;  // nothing else says where the head frame is
  GNATHION_TRY(const ChainSolution solution, solve_poses(problem));
  problem.fixed[head] = false;
  problem.known = known;
  problem.poses = solution.poses;
  const Chain by_scans = assembled(scans, u, solution, problem.terms);
  const std::vector<Vector3> teeth_mm = some_teeth_mm(scans.mandible_mi);
  TrackedAgreement a = compare_therapeutic(by_scans, tracked, teeth_mm);
  if (has_frame) compare_head_frame(u, solution, by_scans.bow_from_dental.value, tracked, teeth_mm, a);
  const auto refuse = [](const std::string& what, double mm, double deg, const std::string& why) {
    return fail(ErrorCode::kGate, "tracked positions contradict the scans", what,
                fmt::format("{:.3f} mm at the teeth and {:.3f} deg apart; {}", mm, deg, why));
  };
  if (a.p_value < kLeastP)
    return refuse("T_th by tracker and by face scans", a.therapeutic_mm, a.therapeutic_deg,
                  "the jaw was elsewhere, or bow or head frame slipped");
  if (a.head_from_bow_p_value < kLeastP)
    return refuse("bow in the head frame at MI", *a.head_from_bow_mm, a.head_from_bow_deg,
                  "another MI, or the head frame's file is not its CAD surface");
  return a;
}

}  // namespace

Result<Chain> solve_chain(const ChainScans& scans, const ChainOptions& options, Progress& progress) {
  GNATHION_CHECK_OK(check_scans(scans, options));
  GNATHION_TRY(ChainStart start, register_scans(scans, options, progress));
  progress.begin_step("all poses together", 0.3);
  std::optional<TrackedAgreement> agreement;
  if (options.tracked) {
    GNATHION_TRY(agreement, agreement_with_scans(scans, *options.tracked, start));
  }
  GNATHION_TRY(const ChainSolution solution, solve_poses(start.problem));
  Chain chain = assembled(scans, start.unknowns, solution, start.problem.terms);
  if (chain.has_faces) judge_face_scans(start.problem.terms, scans.mandible_mi, chain);
  judge_surfaces(start.problem.terms, chain);
  chain.missing = missing_parts(scans, options);
  chain.tracked = agreement;
  return chain;
}

}  // namespace gnathion
