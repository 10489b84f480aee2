// The chain that brings a recorded motion to the teeth: T_D, T_F, T and T_B from scans, solved together.
//
//   clutch scans ─ teeth ─→ mandible in MI (Dental)      bow_from_dental = T_D
//        └─ clutch ─→ bow model (Bow)
//   face scans MI ─ bow ─→ bow model                      bow_from_face = T_F
//   face scans TP ─ bow ─→ bow model                      bow_from_face_tp
//        └─ head frame, upper face ─→ each other          face_mi_from_face_tp
//   tracker ─→ bow in the head frame, at MI and at TP      (K = H⁻¹·M)
//
//   T = T_D⁻¹·T_F,  T_B = face_mi_from_face_tp · bow_from_face_tp⁻¹ · T_F,  T_th = T·T_B·T⁻¹.
//
// Repeated scans share what is the same in them: all clutch scans T_D, all face scans in MI the bow's pose in
// the head, all in TP that in TP. What is told is of the first scan of each kind.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calibration/face_scan_quality.h"
#include "core/mesh.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform.h"

namespace gnathion {

/// Each surface in its own frame, millimetres.
struct ChainScans {
  TriangleMesh mandible_mi;                ///< Dental
  std::vector<TriangleMesh> clutch_scans;  ///< lower teeth with the clutch on; the first is ClutchScan
  TriangleMesh bow_model;                  ///< Bow: the CAD surface, clutch and stem included
  /// With the bow on, in MI and in TP; the first are FaceScanMi and FaceScanTp. None of either: only T_D is
  /// solved.
  std::vector<TriangleMesh> faces_mi, faces_tp;
  /// HeadFrame: the CAD surface of the head frame that all face scans show; may be empty. Without it the
  /// head is found by the face alone, whose soft parts shift by tenths of a millimetre.
  TriangleMesh head_frame_model;
};

/// What a tracker saw of the bow in the head frame; takes part in the same problem as the face scans, if it
/// agrees with them.
struct TrackedPositions {
  Uncertain<Transform<HeadFrame, Bow>> head_from_bow_mi, head_from_bow_tp;
};

struct ChainOptions {
  /// 1σ of each scanner's relative scale; enters the covariances.
  double scan_scale_sigma = 5e-4;
  /// Only with face scans: without them the tracker's poses have nothing to agree with.
  std::optional<TrackedPositions> tracked;
  std::uint64_t seed = 1;
};

/// One pose of the chain with what it says about itself.
struct ChainPose {
  Rigid3 value;
  Matrix6 covariance = Matrix6::Zero();  ///< left perturbation, rad and mm
  double rms_mm = 0.0;
  double held_out_mm = 0.0;
  double condition = 0.0;  ///< of the information, lengths scaled by the body's radius, about its centre
  std::vector<std::string> weak;  ///< "rotation about the bow's long axis is weak: 0.40 deg"
};

/// How far the tracker's positions are from what the scans alone say.
struct TrackedAgreement {
  double therapeutic_mm = 0.0, therapeutic_deg = 0.0;  ///< T_th by the tracker against that by the scans,
                                                       ///< largest over the lower arch
  double p_value = 1.0;                                ///< of that, 6 degrees of freedom
  /// The bow in the head frame at MI, at the teeth; only with the head frame's model. Its own p-value.
  std::optional<double> head_from_bow_mm;
  double head_from_bow_deg = 0.0, head_from_bow_p_value = 1.0;
};

/// The poses that are estimated from surfaces, in the order of the joint covariance.
enum class ChainState { kBowFromDental = 0, kBowFromFace, kBowFromFaceTp, kFaceMiFromFaceTp };
inline constexpr int kChainStates = 4;
using ChainCovariance = Eigen::Matrix<double, 6 * kChainStates, 6 * kChainStates>;

struct Chain {
  ChainPose bow_from_dental;  ///< T_D
  bool has_faces = true;      ///< what follows is known
  ChainPose bow_from_face;    ///< T_F, at MI
  ChainPose bow_from_face_tp;
  ChainPose face_mi_from_face_tp;  ///< the head's motion between the scans
  ChainPose dental_from_face;      ///< T = T_D⁻¹·T_F
  ChainPose bow_motion;            ///< T_B in FaceScanMi, head motion removed
  /// Of the four estimated poses' left perturbations, 6 each in the order of ChainState, cross terms
  /// included.
  ChainCovariance joint = ChainCovariance::Zero();
  FaceScanQuality face_mi, face_tp;
  std::optional<TrackedAgreement> tracked;  ///< of ChainOptions::tracked, which then took part
  /// By name, one line each: "face scan in MI too coarse for T_F: …". The chain stands all the same: its
  /// covariance is as wide as the scans ask.
  std::vector<std::string> warnings;
  /// What was not given, and what is therefore unknown or weaker, one line each.
  std::vector<std::string> missing;

  Transform<Bow, Dental> t_d() const { return Transform<Bow, Dental>(bow_from_dental.value); }
  Transform<Bow, FaceScanMi> t_f() const { return Transform<Bow, FaceScanMi>(bow_from_face.value); }
  Transform<Dental, FaceScanMi> t() const { return Transform<Dental, FaceScanMi>(dental_from_face.value); }
  Motion<FaceScanMi> t_b() const { return Motion<FaceScanMi>(bow_motion.value); }
};

/// Coarse start without a guess for each registration, then one least-squares problem over all poses.
/// Errors (kInput) name the registration that is missing or undetermined; kGate: the tracked positions
/// contradict the scans (p < 0.003), with how far.
Result<Chain> solve_chain(const ChainScans& scans, const ChainOptions& options, Progress& progress);

}  // namespace gnathion
