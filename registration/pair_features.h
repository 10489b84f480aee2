// Pose hypotheses without a guess, by voting of point pairs.
//
// Every pair of oriented points has four numbers that no motion changes: their distance, the angles between
// it and the two normals, and the angle between the normals. Pairs of the scene find like pairs of the model
// in a table and vote for the pose that brings them together (Drost et al., CVPR 2010). Exhaustive over the
// samples, so no random draws; votes of common pairs (planes, cylinders) count little.
#pragma once

#include <vector>

#include "registration/surface_samples.h"

namespace gnathion {

struct PairVotingOptions {
  double distance_bin_mm = 2.5;
  double angle_bin_deg = 15.0;
  double min_distance_mm = 5.0;  ///< shorter pairs say little
  double max_distance_mm = 60.0;
  std::size_t scene_references = 300;  ///< scene points that cast votes
  std::size_t max_hypotheses = 400;
};

struct PoseHypothesis {
  Rigid3 scene_from_model;
  double votes = 0.0;
};

/// Best first; similar poses are merged. Deterministic on any number of threads.
std::vector<PoseHypothesis> vote_poses(const SurfaceSamples& model, const SurfaceSamples& scene,
                                       const PairVotingOptions& options);

}  // namespace gnathion
