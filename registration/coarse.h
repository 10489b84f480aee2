// The pose of one surface on another without a guess.
#pragma once

#include <string>
#include <vector>

#include "core/mesh_query.h"
#include "core/result.h"
#include "registration/surface_samples.h"

namespace gnathion {

/// A surface that takes part in a search: its mesh and which of its triangles count.
struct SearchSurface {
  const TriangleMesh* mesh = nullptr;
  std::vector<bool> keep;  ///< by triangle
};

struct CoarseOptions {
  double overlap = 0.6;  ///< expected fraction of the source that has a counterpart
  double noise_mm = 0.05;
  /// Longest distance between two points that vote together; 0: from the source's size. Shorter where only a
  /// small connected part is common.
  double feature_reach_mm = 0.0;
  /// The best must have this many times the support of a distinct second.
  double clear_margin = 1.15;
  std::uint64_t seed = 1;
  std::string name = "surfaces";
};

struct CoarseMatch {
  Rigid3 target_from_source;
  double support = 0.0;            ///< fraction of the source's area that lies on the target, facing alike
  double runner_up_support = 0.0;  ///< of the best distinct other pose
};

/// Votes for poses by point pairs, verifies the best by the area that they explain, refines a few by robust
/// ICP and takes the best if it is clearly so. Errors (kInput): "undetermined" with both supports.
Result<CoarseMatch> find_pose(const SearchSurface& source, const SearchSurface& target,
                              const MeshQuery& target_query, const CoarseOptions& options);

}  // namespace gnathion
