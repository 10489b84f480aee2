// bow_calibration.json: {"tags":[{"id","corners_mm","covariance_mm2",…}],"held_out_px","condition","weak",…}
// (docs/bow.md).
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "calibration/bow_geometry.h"

namespace gnathion {

nlohmann::json bow_geometry_json(const BowGeometry& geometry);

}  // namespace gnathion
