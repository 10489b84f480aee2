// From a film of bow or head frame to the tags' corners: detection, then calibration/bow_geometry.h.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calibration/bow_geometry.h"
#include "core/progress.h"
#include "core/source.h"

namespace gnathion {

struct BowFilmOptions {
  BowGeometryOptions geometry;
  double interval_s = 0.1;  ///< between the frames that are looked at
  int threads = 2;
};

/// What the film was made of.
struct BowFilmSummary {
  std::size_t frames = 0;     ///< of the rig's cameras
  std::size_t instants = 0;   ///< looked at
  std::size_t with_pose = 0;  ///< of these
};

/// Pulls the source to its end, finds tags in an instant every interval_s, and starts each view from the
/// nominal layout. Refused (kInput): no frame of the rig's cameras, images of another size, no tags (mirrored
/// images are named), and all that calibrate_bow_geometry refuses.
Result<BowGeometry> calibrate_bow_film(Source& source, const std::vector<RigCamera>& cameras,
                                       const TaggedBody& nominal, const BowFilmOptions& options,
                                       Progress& progress, BowFilmSummary* summary = nullptr);

/// "0-7=181.35", "0.1-7.2=181.35" or "…=181.35/0.03": tags (and corners 0 to 3), millimetres, standard
/// deviation. kUsage for anything else.
Result<KnownDistance> parse_distance(const std::string& text);

/// A table for people.
std::string bow_geometry_text(const BowGeometry& geometry);

}  // namespace gnathion
