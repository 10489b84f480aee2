// What can be chosen about a splint: each value with unit, default, range and source.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"

namespace gnathion {

/// Lengths in millimetres. Symbols as in docs/design.md.
struct SplintParameters {
  double voxel_mm = 0.1;  ///< spacing of the fine grid (reference plugin: 0.1)
  double wall_mm = 1.0;   ///< w, minimum wall (published side wall: 1.0)
  double occlusal_thickness_mm =
      1.5;                       ///< over biting surfaces, where there is room (published: 1.5, 0.8-2.5)
  double gap_mm = 0.1;           ///< g, seat gap at the walls (PMID 31053289: 0.1 best of 0.05-0.12)
  double stop_gap_mm = 0.0;      ///< h, the same over occlusal surfaces: the splint seats on teeth
  double stop_angle_deg = 40.0;  ///< occlusal surfaces: outward normal within this of -a
  double engagement_mm = 0.05;   ///< r, net engagement below the height of contour (published: 0-0.05)
  double depth_mm = 4.0;         ///< cutting plane, behind the local occlusal level of the arch
  double occlusion_clearance_mm = 0.2;  ///< o, to the mandible in TP outside contacts (reference plugin: 0.2)
  double aperture_limit_mm = 0.5;       ///< w_a, less than this between cavity and mandible opens an aperture
  double stamp_height_mm = 3.5;   ///< height of S_occ over the local occlusal level that is carried to TP
  double imprint_depth_mm = 0.5;  ///< d, imprint of the opposing arch beyond the natural relief, at most
  double draft_deg = 35.0;        ///< draft of the stamp's side walls against a
  double smoothing_mm = 2.0;      ///< radius of the concave fillets between shell and stamp
  double rim_radius_mm = 0.4;     ///< rounding of the rim
  /// Teeth that are covered, by position from the midline, on both sides: 1 to 8 all of them, 1 to 3 an
  /// anterior splint, 4 to 8 a posterior one (two pieces).
  double first_tooth = 1.0, last_tooth = 8.0;
  double insertion_search_deg = 15.0;   ///< a is sought within this of its start; 0: the start itself
  double insertion_left_deg = 0.0;      ///< start of a: the occlusal normal, tilted to the patient's left ...
  double insertion_anterior_deg = 0.0;  ///< ... and forward
  double excursion_mm = 0.0;            ///< straight excursions from TP run free this far; 0: none
  double protrusion_deg = 30.0;         ///< their way down forwards ...
  double laterotrusion_deg = 15.0;      ///< ... and sidewards
  double disclusion_mm = 0.0;           ///< the splint stays this far from the opposing arch on excursions
  /// 0: positioning splint; flat-plane stabilisation splint, its plane parallel to the occlusal plane (1) or
  /// by least squares through the opposing tips (2).
  double flat_plane = 0.0;
  double plane_indent_mm = 0.2;     ///< no tip of canines to molars goes deeper into the plane
  double canine_ramp_deg = 30.0;    ///< guidance before the canines: its angle to the plane ...
  double canine_ramp_mm = 2.5;      ///< ... and length; 0: none
  double anterior_ramp_deg = 30.0;  ///< the same before the incisors
  double anterior_ramp_mm = 2.0;
  double embrasure_mm = 0.5;  ///< interdental grooves narrower than twice this are not filled by the splint
};

inline bool is_flat(const SplintParameters& p) {
  return p.flat_plane > 0.5;
}
/// How many pieces such a splint has.
inline std::size_t pieces_of(const SplintParameters& p) {
  return p.first_tooth > 1.5 ? 2 : 1;
}

/// Refuses (kUsage) what is out of range or contradicts itself, naming the parameter.
Status check_parameters(const SplintParameters& parameters);

/// Reads the [design] table of a TOML file over `base`. Unknown keys are refused by name (kInput).
Result<SplintParameters> read_parameters(const std::filesystem::path& toml, SplintParameters base = {});
/// The same from text; `name` stands in errors.
Result<SplintParameters> parse_parameters(std::string_view toml, const std::string& name,
                                          SplintParameters base = {});

/// One "design.voxel_mm=0.1" of the command line (kUsage if unknown, not a number, out of range).
Status set_parameter(SplintParameters& parameters, std::string_view key_equals_value);

/// All effective values by name.
nlohmann::json parameters_json(const SplintParameters& parameters);

/// For --help and docs: name, unit, default, range, source, one a row.
struct ParameterHelp {
  std::string name, unit, source;
  double default_value, low, high;
};
std::vector<ParameterHelp> parameter_help();

}  // namespace gnathion
