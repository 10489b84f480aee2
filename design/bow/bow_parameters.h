// What can be chosen about bow and head frame: lengths in millimetres.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"

namespace gnathion {

struct BowParameters {
  double bonding_gap_mm = 0.1;  ///< between clutch and teeth
  double clutch_thickness_mm = 1.8;
  double engagement_mm = 0.05;        ///< net interference that insertion from the labial side may meet
  double rim_below_edge_mm = 0.8;     ///< the clutch ends this far below the lower incisal edges
  double gingiva_distance_mm = 0.5;   ///< and this far above the gingival margin
  double flange_mm = 2.5;             ///< below that, off the gingiva by 1 mm: it stiffens the clutch
  double maxilla_clearance_mm = 0.7;  ///< built with this; the gate asks for 0.5
  double stem_width_mm = 11.0, stem_height_mm = 4.8;
  double carrier_distance_mm = 50.0;     ///< of the tags' middle before the lower incisors
  double tag_side_mm = 20.0;             ///< of the black square
  double sticker_thickness_mm = 0.1;     ///< paper and glue: the tag stands this high over its pocket's floor
  double forehead_radius_mm = 85.0;      ///< of the head frame's band
  double opening_deg = 0.0;              ///< the maxilla must be clear while the jaw opens by this …
  double protrusion_mm = 0.0;            ///< … and slides forward by this
  double protrusion_descent_deg = 35.0;  ///< of that path below the occlusal plane
  double fine_mm = 0.25;                 ///< voxel of the surfaces
  double density_g_per_cm3 = 1.18;       ///< of the resin
};

/// Reads the [bow] table of a TOML file over `base`; unknown keys and values out of range are refused by
/// name.
Result<BowParameters> read_bow_parameters(const std::filesystem::path& toml, BowParameters base = {});
Result<BowParameters> parse_bow_parameters(std::string_view toml, const std::string& name,
                                           BowParameters base = {});
nlohmann::json bow_parameters_json(const BowParameters& parameters);

}  // namespace gnathion
