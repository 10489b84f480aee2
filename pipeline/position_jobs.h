// Two questions about recorded positions: how far CR is from MI, and how two instruments stand to each other.
// What `gnathion evaluate discrepancy` and `gnathion evaluate registration-object` do (docs/evaluation.md).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "evaluation/discrepancy.h"
#include "evaluation/registration_object.h"

namespace gnathion {

struct DiscrepancyJob {
  std::vector<std::filesystem::path> mi,
      cr;                                   ///< motions of the mandible from the scanned MI, with covariance
  std::filesystem::path maxilla, mandible;  ///< arches in MI: directions, and landmarks on the teeth
  std::vector<std::string> landmarks;       ///< further ones: "condyle_left=48.1,91.0,33.5", Dental, in MI
};
/// Errors: kUsage for a landmark that is none, kInput for files; a motion without covariance is refused.
Result<Discrepancy> run_discrepancy(const DiscrepancyJob& job);
nlohmann::json discrepancy_json(const Discrepancy& d);
std::string discrepancy_text(const Discrepancy& d);

/// positions.json: {"common_object_frame":true,"positions":[{"name","a_from_object":P,"b_from_object":P}…]}
/// with P = {"matrix":[4×4],"covariance":[6×6]|null}.
Result<InstrumentLink> run_registration_object(const std::filesystem::path& positions);
nlohmann::json instrument_link_json(const InstrumentLink& link);
std::string instrument_link_text(const InstrumentLink& link);

}  // namespace gnathion
