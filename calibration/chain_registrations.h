// Every scan of the chain on what it shows, without a guess: where the joint problem starts, and the points
// that it fits.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "calibration/chain.h"
#include "calibration/chain_problem.h"

namespace gnathion {

/// Whether other scans are brought onto a surface: queries take long to build.
enum class Role { kSought, kTarget };

/// A surface, its distance queries if it is a target, and the centre about which its scale error acts.
struct ChainSurface {
  const TriangleMesh& mesh;
  Vector3 centre_mm;
  std::optional<MeshQuery> query;
  ChainSurface(const TriangleMesh& m, Role role) : mesh(m), centre_mm(surface_centroid_mm(m)) {
    if (role == Role::kTarget) query.emplace(m);
  }
};

/// Unknowns: T_D; bow_from_clutch of each clutch scan; head_from_face of each face scan, MI first; with faces
/// K = head_from_bow at MI and at TP. Where neither a head frame's model nor a tracker says where the head
/// frame is, the head is told in the first face scan's frame, which is then held fixed.
struct ChainUnknowns {
  int t_d = 0, first_clutch = 1;
  int first_face_mi = -1, first_face_tp = -1;
  int head_from_bow_mi = -1, head_from_bow_tp = -1;
  int count = 0;
};
ChainUnknowns unknowns_of(const ChainScans& scans);

/// Pools of like noise.
enum ChainNoisePool { kTeethNoise = 0, kClutchNoise, kFaceNoise, kSkinNoise };

struct ChainStart {
  ChainUnknowns unknowns;
  ChainProblem problem;
  /// What the problem's terms refer to: queries of the surfaces.
  std::vector<std::unique_ptr<ChainSurface>> surfaces;
};

/// Errors (kInput) name the registration that is undetermined.
Result<ChainStart> register_scans(const ChainScans& scans, const ChainOptions& options, Progress& progress);

}  // namespace gnathion
