// T_th as people read it: displacements of landmarks with 95 % bounds, a screw axis, an error map.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calibration/composition.h"
#include "calibration/displacement.h"
#include "core/result.h"
#include "occlusion/arch.h"

namespace gnathion {

/// Points of the mandible in MI where motions and errors are told; condyles by Bonwill's triangle.
struct MandibleLandmarks {
  ArchFrame arch;
  std::vector<std::string> names;
  std::vector<Vector3> points_mm;
  Vector3 arch_centroid_mm = Vector3::Zero();
};
Result<MandibleLandmarks> mandible_landmarks(const TriangleMesh& maxilla, const TriangleMesh& mandible);

/// Landmarks, screw axis and the motion of the arch's centroid. Where the covariance is unknown every bound
/// and sigma is null.
nlohmann::json displacement_json(const Motion<Dental>& motion, const std::optional<Matrix6>& covariance,
                                 const MandibleLandmarks& landmarks);
std::string displacement_text(const Motion<Dental>& motion, const std::optional<Matrix6>& covariance,
                              const MandibleLandmarks& landmarks);
/// "turns by 3.0° (±0.02) about an axis …" in one line.
std::string screw_text(const ScrewAxis& screw, bool with_sigmas);

/// error_map.ply (the mandible in MI, coloured by the 95 % bound of each vertex's place in TP) and
/// pictures/error_map.png.
Status write_error_map(const Uncertain<Motion<Dental>>& therapeutic, const TriangleMesh& mandible,
                       const ArchFrame& arch, const std::filesystem::path& folder);

/// What is odd about a T_th that was given by hand, one line each; nothing is refused that could be meant.
std::vector<std::string> oddities_of(const Motion<Dental>& motion, const MandibleLandmarks& landmarks);

}  // namespace gnathion
