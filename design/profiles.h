// Profiles of a finished splint: sections perpendicular to the arch, at each covered tooth and wherever a
// gate is tight, as curves and numbers. The method's own way of finding conflicts.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/mesh_section.h"
#include "design/splint.h"

namespace gnathion {

/// All lengths are measured in the plane of the section, mm: never less than the distance in space.
struct SplintProfile {
  std::string name;    ///< "16", "wall_min_mm", "aperture_2"
  std::string cause;   ///< why it was drawn: "tooth 16", "wall_min_mm 0.81, limit 0.48"
  double s_mm = 0.0;   ///< along the arch of the splint's jaw from the midline, the patient's left positive
  SectionPlane plane;  ///< Dental; x points to buccal, y up
  // Curves in plane coordinates, cut to the window about the arch.
  std::vector<Polyline2> splint, support, opposing, inner, outer, occlusal;
  /// From the inner surface to the outer one; nothing where the section has no wall.
  std::optional<double> wall_min_mm, wall_median_mm;
  std::array<Eigen::Vector2d, 2> thinnest = {};  ///< both ends of that wall
  /// From the inner surface to the teeth.
  std::optional<double> gap_min_mm, gap_median_mm, gap_max_mm;
  /// From the opposing arch in TP to the splint; negative inside of it. Nothing where they are farther apart
  /// than the window.
  std::optional<double> clearance_mm;
};

/// Half of the window about the arch curve.
constexpr double kProfileHalfMm = 11.0;

/// Right to left by teeth, then the tight places. A place within 0.5 mm of a section that is there already is
/// told there.
std::vector<SplintProfile> splint_profiles(const SplintInputs& inputs, const SplintDesign& design);

/// [{"name","cause","s_mm","origin_mm","buccal","up","wall_min_mm",…}]; null for what is not there.
nlohmann::json profiles_json(const std::vector<SplintProfile>& profiles);

}  // namespace gnathion
