// Rigid alignment of two surfaces: with or without a guess, with what it does not know said aloud.
//
// The result is refused (kInput, "undetermined") rather than wrong: when too little of the source finds
// a counterpart, or when a distinctly different pose explains the surfaces nearly as well.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"
#include "core/rigid.h"

namespace gnathion {

struct AlignOptions {
  /// A guess within about 3 mm and 5°; none: coarse search over all poses.
  std::optional<Rigid3> initial_target_from_source;
  /// Vertices that take part; empty = all. A triangle takes part when all its corners do.
  std::vector<bool> source_vertex_mask;
  std::vector<bool> target_vertex_mask;
  /// Expected fraction of the (masked) source's area that has a counterpart on the target; the coarse search
  /// demands at least half of it.
  double overlap = 0.6;
  /// Expected noise of the two surfaces together, 1σ. The scale of the fit is estimated; this is only its
  /// floor and the coarse tolerance's base.
  double noise_mm = 0.05;
  /// Correspondences beyond this are never used in the last iterations.
  double gate_mm = 2.0;
  /// 1σ of an unknown relative scale between the surfaces (0.0005 = 0.05 %); enters the covariance only.
  double scale_sigma = 0.0;
  /// Points of the fit; besides them, a quarter as many (20 % of all) are held out.
  std::size_t points = 8000;
  std::uint64_t seed = 1;
  /// What is aligned, for errors: "face scan in TP".
  std::string name = "surfaces";
};

/// What one surface registration says about itself.
struct Alignment {
  Rigid3 target_from_source;
  /// Of the left perturbation (rad, mm), inflated for residuals that are correlated over the surface.
  Matrix6 covariance = Matrix6::Zero();
  double rms_mm = 0.0;       ///< of the residuals along the normal that took part
  double held_out_mm = 0.0;  ///< the same for points that never took part
  /// Of the information matrix about the cloud's centroid, lengths scaled by its radius.
  double condition = 0.0;
  /// Directions that the data hardly determine, in words; empty when all is well determined.
  std::vector<std::string> weak;
  double inlier_fraction = 0.0;        ///< of the source's samples that found a counterpart within the gate
  std::size_t points = 0;              ///< that took part
  double noise_sigma_mm = 0.0;         ///< uncorrelated part of the residuals
  double correlated_sigma_mm = 0.0;    ///< correlated part
  double correlation_length_mm = 0.0;  ///< its range: correlation exp(−d²/2ℓ²)
};

/// Aligns `source` to `target`. Deterministic for given options.
/// Errors (kInput): empty surfaces, "undetermined" (see above), not converged, and, without a guess, surfaces
/// that match when one is mirrored and do not as they are.
Result<Alignment> align_surfaces(const TriangleMesh& source, const TriangleMesh& target,
                                 const AlignOptions& options = {});

}  // namespace gnathion
