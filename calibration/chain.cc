#include "calibration/chain.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "calibration/chain_derived.h"
#include "calibration/chain_problem.h"
#include "registration/coarse.h"

namespace gnathion {
namespace {

// Poses of the joint problem. With a head frame's model the head has one pose for each face scan, else only
// the one between them.
enum Unknown { kTD = 0, kBowFromClutch, kTF, kTFTp, kHeadMi, kHeadTp, kUnknowns, kFaceMiFromTp = kHeadMi };
enum Scanner { kIntraoral = 0, kClutch, kFace, kScanners };

constexpr double kScanNoise_mm = 0.03;  // of two scans against each other
constexpr double kOnBow_mm = 1.0;       // a face scan's surface this near to the found bow is the bow's
constexpr double kOffBow_mm = 4.0;      // and beyond this it is not
constexpr double kRigidHead_mm = 0.04;  // soft tissue that shifts more is not head
constexpr double kSkinPatch_mm = 0.02;  // Tukey scale of a skin patch's mean: beyond 0.1 mm it has shifted
constexpr std::size_t kPointsPerTerm = 6000;

/// A scan with its distance queries and the centre about which its scale error acts.
struct Scan {
  const TriangleMesh& mesh;
  MeshQuery query;
  Vector3 centre_mm;
  explicit Scan(const TriangleMesh& m) : mesh(m), query(m), centre_mm(surface_centroid_mm(m)) {}
};

Vector3 triangle_centre(const TriangleMesh& mesh, std::size_t t) {
  return (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
}

/// Distance of each triangle's centre to a surface under a pose; `far_mm` where there is none nearer.
std::vector<double> distances_to(const TriangleMesh& mesh, const MeshQuery& surface,
                                 const Rigid3& surface_from_mesh, double far_mm) {
  std::vector<double> out(mesh.triangles.size(), far_mm);
  for (std::size_t t = 0; t < out.size(); ++t) {
    const auto closest = surface.closest(surface_from_mesh * triangle_centre(mesh, t), far_mm);
    if (closest) out[t] = closest->distance_mm;
  }
  return out;
}

std::vector<bool> where(const std::vector<double>& values, double low, double high) {
  std::vector<bool> out(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) out[i] = values[i] >= low && values[i] <= high;
  return out;
}

struct Found {
  Rigid3 pose;
  double scale_mm = 0.0;
};

/// Coarse search and a first fit of the kept part of `source` on the kept part of `target`.
Result<Found> locate(const SearchSurface& source, const SearchSurface& target, const MeshQuery& query,
                     const CoarseOptions& options) {
  GNATHION_TRY(const CoarseMatch match, find_pose(source, target, query, options));
  const SurfaceSamples samples = sample_surface(*source.mesh, source.keep, 4000, options.seed);
  IcpOptions icp;
  icp.first_gate_mm = 2.0;
  icp.last_gate_mm = 0.6;
  icp.noise_mm = 0.5 * kScanNoise_mm;
  const IcpResult fit = robust_icp(samples, query, target.keep, match.target_from_source, icp);
  return Found{fit.target_from_source, fit.scale_mm};
}

CoarseOptions coarse(const std::string& name, double overlap, std::uint64_t seed) {
  CoarseOptions o;
  o.name = name;
  o.overlap = overlap;
  o.noise_mm = kScanNoise_mm;
  o.seed = seed;
  return o;
}

std::vector<bool> all_of(const TriangleMesh& mesh) {
  return std::vector<bool>(mesh.triangles.size(), true);
}

SurfaceTerm term_of(std::string name, const TriangleMesh& scan, const std::vector<bool>& keep,
                    const MeshQuery& surface, std::uint64_t seed) {
  SurfaceTerm term;
  term.name = std::move(name);
  term.surface = &surface;
  set_samples(term, sample_surface(scan, keep, kPointsPerTerm * 5 / 4, seed));
  return term;
}

/// T_D: the clutch scan's teeth on the lower arch, the rest of it on the bow.
Status add_clutch(const ChainScans& scans, const Scan& mandible, const Scan& clutch, const Scan& bow,
                  std::uint64_t seed, std::vector<Rigid3>& poses, std::vector<SurfaceTerm>& terms) {
  GNATHION_TRY(const Found on_teeth, locate({&scans.clutch_scan, all_of(scans.clutch_scan)},
                                            {&scans.mandible_mi, all_of(scans.mandible_mi)}, mandible.query,
                                            coarse("clutch scan on lower arch", 0.5, seed)));
  const std::vector<double> off_teeth = distances_to(scans.clutch_scan, mandible.query, on_teeth.pose, 5.0);
  const std::vector<bool> not_teeth = where(off_teeth, 0.5, 5.0);
  GNATHION_TRY(const Found on_bow,
               locate({&scans.clutch_scan, not_teeth}, {&scans.bow_model, all_of(scans.bow_model)}, bow.query,
                      coarse("clutch scan on bow", 0.7, seed)));
  poses[kBowFromClutch] = on_bow.pose;
  poses[kTD] = on_bow.pose * on_teeth.pose.inverse();

  const std::vector<double> off_bow = distances_to(scans.clutch_scan, bow.query, on_bow.pose, 5.0);
  std::vector<bool> teeth = where(off_teeth, 0.0, 0.4), bow_part = where(off_bow, 0.0, 0.4);
  for (std::size_t t = 0; t < teeth.size(); ++t) {
    // Where clutch and teeth meet, the nearer one has it, and what could be either has none.
    if (off_bow[t] < 0.6) teeth[t] = false;
    if (off_teeth[t] < 0.5) bow_part[t] = false;
  }
  SurfaceTerm on_arch =
      term_of("clutch scan on lower arch", scans.clutch_scan, teeth, mandible.query, seed + 1);
  on_arch.left = kTD;
  on_arch.right = kBowFromClutch;
  on_arch.scanner = kClutch;
  on_arch.scale_centre_mm = clutch.centre_mm;
  on_arch.surface_scanner = kIntraoral;
  on_arch.surface_scale_centre_mm = mandible.centre_mm;
  terms.push_back(std::move(on_arch));
  SurfaceTerm on_cad = term_of("clutch scan on bow", scans.clutch_scan, bow_part, bow.query, seed + 2);
  on_cad.right = kBowFromClutch;
  on_cad.scanner = kClutch;
  on_cad.scale_centre_mm = clutch.centre_mm;
  terms.push_back(std::move(on_cad));
  return {};
}

/// The bow in a face scan: its pose into poses[state], and what of the scan is not bow.
Result<std::vector<bool>> add_bow_in_face(const ChainScans& scans, const Scan& face, const Scan& bow,
                                          int state, const std::string& name, std::uint64_t seed,
                                          std::vector<Rigid3>& poses, std::vector<SurfaceTerm>& terms) {
  GNATHION_TRY(const Found found,
               locate({&scans.bow_model, all_of(scans.bow_model)}, {&face.mesh, all_of(face.mesh)},
                      face.query, coarse(name, 0.4, seed)));
  poses[static_cast<std::size_t>(state)] = found.pose.inverse();
  const std::vector<double> off_bow = distances_to(face.mesh, bow.query, found.pose.inverse(), kOffBow_mm);
  SurfaceTerm term = term_of(name, face.mesh, where(off_bow, 0.0, kOnBow_mm), bow.query, seed + 3);
  term.right = state;
  term.scanner = kFace;
  term.scale_centre_mm = face.centre_mm;
  terms.push_back(std::move(term));
  return where(off_bow, kOffBow_mm, kOffBow_mm);
}

/// The head between the two face scans: by the head frame where its model is known, and by all that is rigid
/// in them and not bow.
Status add_head(const ChainScans& scans, const Scan& face_mi, const Scan& face_tp, const Scan* head_frame,
                const std::vector<bool>& head_mi, const std::vector<bool>& head_tp, std::uint64_t seed,
                std::vector<Rigid3>& poses, std::vector<SurfaceTerm>& terms) {
  const std::string name = "head between face scans";
  GNATHION_TRY(const Found found, locate({&face_tp.mesh, head_tp}, {&face_mi.mesh, head_mi}, face_mi.query,
                                         coarse(name, 0.6, seed)));
  SurfaceTerm skin = term_of(name, face_tp.mesh, head_tp, face_mi.query, seed + 4);
  skin.keep = head_mi;
  skin.scale_cap_mm = kRigidHead_mm;
  skin.scanner = skin.surface_scanner = kFace;
  skin.scale_centre_mm = face_tp.centre_mm;
  skin.surface_scale_centre_mm = face_mi.centre_mm;
  if (head_frame == nullptr) {
    poses[kFaceMiFromTp] = found.pose;
    poses.resize(kFaceMiFromTp + 1);
    skin.right = kFaceMiFromTp;
    terms.push_back(std::move(skin));
    return {};
  }
  GNATHION_TRY(const Found frame,
               locate({&scans.head_frame_model, all_of(scans.head_frame_model)}, {&face_mi.mesh, head_mi},
                      face_mi.query, coarse("head frame in face scan in MI", 0.4, seed + 1)));
  poses[kHeadMi] = frame.pose.inverse();
  poses[kHeadTp] = frame.pose.inverse() * found.pose;
  const auto add_frame = [&](const Scan& face, Unknown state, const char* frame_name) {
    const std::vector<double> off_frame =
        distances_to(face.mesh, head_frame->query, poses[state], kOffBow_mm);
    SurfaceTerm term =
        term_of(frame_name, face.mesh, where(off_frame, 0.0, kOnBow_mm), head_frame->query, seed + 5);
    term.right = state;
    term.scanner = kFace;
    term.scale_centre_mm = face.centre_mm;
    terms.push_back(std::move(term));
  };
  add_frame(face_mi, kHeadMi, "head frame in face scan in MI");
  add_frame(face_tp, kHeadTp, "head frame in face scan in TP");
  // The skin lengthens the lever towards the teeth, as far as it moved with the frame.
  skin.left = kHeadMi;
  skin.right = kHeadTp;
  skin.scale_cap_mm = 1e9;
  skin.patch_scale_mm = kSkinPatch_mm;
  terms.push_back(std::move(skin));
  return {};
}

/// The estimated poses that the chain reports, and how they depend on the problem's unknowns.
struct Reported {
  std::vector<Rigid3> poses;
  Eigen::MatrixXd jacobian;
};
Reported reported_poses(const std::vector<Rigid3>& x, bool faces) {
  const auto n = static_cast<long>(x.size());
  Reported r;
  r.jacobian = Eigen::MatrixXd::Zero(6 * kChainStates, 6 * n);
  const auto take = [&](ChainState state, Unknown unknown) {
    r.jacobian.block<6, 6>(6 * static_cast<int>(state), 6 * unknown).setIdentity();
    r.poses.push_back(x[unknown]);
  };
  take(ChainState::kBowFromDental, kTD);
  if (!faces) return r;
  take(ChainState::kBowFromFace, kTF);
  take(ChainState::kBowFromFaceTp, kTFTp);
  if (n == kFaceMiFromTp + 1) {
    take(ChainState::kFaceMiFromFaceTp, kFaceMiFromTp);
    return r;
  }
  // F = Hm⁻¹·Ht.
  const Rigid3 face_mi_from_head = x[kHeadMi].inverse();
  r.poses.push_back(face_mi_from_head * x[kHeadTp]);
  const int row = 6 * static_cast<int>(ChainState::kFaceMiFromFaceTp);
  r.jacobian.block<6, 6>(row, 6 * kHeadMi) = -adjoint(face_mi_from_head);
  r.jacobian.block<6, 6>(row, 6 * kHeadTp) = adjoint(face_mi_from_head);
  return r;
}

/// A pose of the chain that leans on some of the terms.
ChainPose pose_from(const Rigid3& value, const Matrix6& covariance,
                    const std::vector<const SurfaceTerm*>& terms, const std::vector<Rigid3>& poses) {
  ChainPose pose;
  pose.value = value;
  pose.covariance = 0.5 * (covariance + covariance.transpose());
  double sum = 0.0, held_out = 0.0;
  for (const SurfaceTerm* term : terms) {
    sum += term->rms_mm * term->rms_mm / static_cast<double>(terms.size());
    held_out += term->held_out_mm * term->held_out_mm / static_cast<double>(terms.size());
    const Rigid3 x = pose_of(*term, poses);
    const Matrix6 bread = information(term->pairs, x).inverse();
    const Matrix6 own = bread * score_covariance(term->pairs, x, term->noise) * bread;
    const Conditioning c = conditioning(term->pairs, x, own);
    pose.condition = std::max(pose.condition, c.condition);
    for (const std::string& w : c.weak) pose.weak.push_back(term->name + ": " + w);
  }
  pose.rms_mm = std::sqrt(sum);
  pose.held_out_mm = std::sqrt(held_out);
  return pose;
}

/// The solution in the chain's own terms.
Chain assembled(const ChainSolution& solution, const std::vector<SurfaceTerm>& terms, bool faces) {
  Chain chain;
  chain.has_faces = faces;
  const Reported reported = reported_poses(solution.poses, faces);
  chain.joint = reported.jacobian * solution.covariance * reported.jacobian.transpose();
  // Terms in the order in which they were added; those of the head come last.
  const SurfaceTerm *teeth = &terms[0], *clutch = &terms[1];
  const auto own = [&](ChainState state, const std::vector<const SurfaceTerm*>& from) {
    const int k = static_cast<int>(state);
    return pose_from(reported.poses[static_cast<std::size_t>(k)], chain.joint.block<6, 6>(6 * k, 6 * k), from,
                     solution.poses);
  };
  chain.bow_from_dental = own(ChainState::kBowFromDental, {teeth, clutch});
  if (!faces) return chain;
  std::vector<const SurfaceTerm*> head;
  for (std::size_t i = 4; i < terms.size(); ++i) head.push_back(&terms[i]);
  chain.bow_from_face = own(ChainState::kBowFromFace, {&terms[2]});
  chain.bow_from_face_tp = own(ChainState::kBowFromFaceTp, {&terms[3]});
  chain.face_mi_from_face_tp = own(ChainState::kFaceMiFromFaceTp, head);
  const auto derived = [&](const ChainDerived& d, const std::vector<const SurfaceTerm*>& from) {
    return pose_from(d.value, d.jacobian * chain.joint * d.jacobian.transpose(), from, solution.poses);
  };
  chain.dental_from_face = derived(dental_from_face_of(chain), {teeth, clutch, &terms[2]});
  std::vector<const SurfaceTerm*> moving = {&terms[2], &terms[3]};
  moving.insert(moving.end(), head.begin(), head.end());
  chain.bow_motion = derived(bow_motion_of(chain), moving);
  return chain;
}

/// Says how fine the face scans are, and whether that is fine enough.
void judge_face_scans(const std::vector<SurfaceTerm>& terms, const TriangleMesh& mandible, Chain& chain) {
  constexpr std::size_t kTeeth = 500;
  std::vector<Vector3> teeth_in_bow_mm;
  const std::size_t step = mandible.vertices_mm.size() / kTeeth + 1;
  for (std::size_t v = 0; v < mandible.vertices_mm.size(); v += step)
    teeth_in_bow_mm.push_back(chain.bow_from_dental.value * mandible.vertices_mm[v]);
  chain.face_mi = face_scan_quality(terms[2].noise, chain.bow_from_face.covariance, teeth_in_bow_mm);
  chain.face_tp = face_scan_quality(terms[3].noise, chain.bow_from_face_tp.covariance, teeth_in_bow_mm);
  for (const auto& [name, quality] :
       {std::pair{"face scan in MI", chain.face_mi}, std::pair{"face scan in TP", chain.face_tp}})
    if (const auto warning = too_coarse(name, quality)) chain.warnings.push_back(*warning);
}

Status check_units(const TriangleMesh& mesh, const char* name, double least_mm, double most_mm) {
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

Status check_scans(const ChainScans& scans) {
  GNATHION_CHECK_OK(check_units(scans.mandible_mi, "mandible in MI", 25, 150));
  GNATHION_CHECK_OK(check_units(scans.clutch_scan, "clutch scan", 25, 200));
  GNATHION_CHECK_OK(check_units(scans.bow_model, "bow model", 25, 500));
  if (scans.face_mi.empty() && scans.face_tp.empty()) return {};
  GNATHION_CHECK_OK(check_units(scans.face_mi, "face scan in MI", 80, 800));
  GNATHION_CHECK_OK(check_units(scans.face_tp, "face scan in TP", 80, 800));
  if (scans.head_frame_model.empty()) return {};
  return check_units(scans.head_frame_model, "head frame model", 25, 500);
}

}  // namespace

Result<Chain> solve_chain(const ChainScans& scans, const ChainOptions& options, Progress& progress) {
  GNATHION_CHECK_OK(check_scans(scans));
  const bool faces = !scans.face_mi.empty();
  const Scan mandible(scans.mandible_mi), clutch(scans.clutch_scan), bow(scans.bow_model);
  std::optional<Scan> face_mi, face_tp, head_frame;
  std::vector<Rigid3> poses(faces ? kUnknowns : kBowFromClutch + 1);
  std::vector<SurfaceTerm> terms;

  progress.begin_step("clutch scan to lower teeth and bow", 0.2);
  GNATHION_CHECK_OK(add_clutch(scans, mandible, clutch, bow, options.seed, poses, terms));
  if (faces) {
    face_mi.emplace(scans.face_mi);
    face_tp.emplace(scans.face_tp);
    if (!scans.head_frame_model.empty()) head_frame.emplace(scans.head_frame_model);
    progress.begin_step("bow in the face scans", 0.3);
    GNATHION_TRY(const std::vector<bool> head_mi,
                 add_bow_in_face(scans, *face_mi, bow, kTF, "bow in face scan in MI", options.seed + 10,
                                 poses, terms));
    GNATHION_TRY(const std::vector<bool> head_tp,
                 add_bow_in_face(scans, *face_tp, bow, kTFTp, "bow in face scan in TP", options.seed + 20,
                                 poses, terms));
    progress.begin_step("head between the face scans", 0.2);
    GNATHION_CHECK_OK(add_head(scans, *face_mi, *face_tp, head_frame ? &*head_frame : nullptr, head_mi,
                               head_tp, options.seed + 30, poses, terms));
  }

  progress.begin_step("all poses together", 0.3);
  const std::vector<double> scale_sigmas(kScanners, options.scan_scale_sigma);
  GNATHION_TRY(const ChainSolution solution, solve_poses(poses, terms, scale_sigmas));
  Chain chain = assembled(solution, terms, faces);
  if (faces) judge_face_scans(terms, scans.mandible_mi, chain);
  return chain;
}

}  // namespace gnathion
