// chain.json: {"bow_from_dental":P,"bow_from_face":P,"dental_from_face":P,"bow_motion":P,…} with
// P = {"matrix","covariance","rms_mm","held_out_mm","condition","weak"} (docs/formats.md).
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "calibration/chain.h"
#include "core/result.h"

namespace gnathion {

nlohmann::json chain_json(const Chain& chain);
nlohmann::json pose_json(const ChainPose& pose);
/// Only "bow_from_dental" is required; without the face poses `has_faces` is false. `where` stands in errors.
Result<Chain> chain_from_json(const nlohmann::json& j, const std::string& where);

}  // namespace gnathion
