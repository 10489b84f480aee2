// `gnathion range`: the map of what a splint can hold for this patient, and its picture.
#pragma once

#include <atomic>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "anatomy/realizable_range.h"
#include "pipeline/check_job.h"

namespace gnathion {

struct RangeOutcome {
  RealizableRange range;
  std::optional<Eigen::Vector2d> tp;  ///< where T_th lies on the map, if one was given
  JawCoordinates tp_coordinates;
  bool tp_on_plane = true;  ///< T_th's other coordinates are those that the map was made through
  Vector3 condyle_middle_mm = Vector3::Zero();
  std::vector<std::string> notes;
};

/// Coordinates that are held at a value, instead of T_th's.
using HeldAxes = std::vector<std::pair<JawAxis, double>>;

/// The other four coordinates are T_th's where there is one, else options.through; but for those in `held`.
Result<RangeOutcome> run_range(const Patient& patient, RangeOptions options,
                               const std::optional<Motion<Dental>>& therapeutic, const HeldAxes& held,
                               Progress& progress, const std::atomic<bool>* cancel = nullptr);
nlohmann::json range_json(const RangeOutcome& outcome);
std::string range_text(const RangeOutcome& outcome);
/// Colours and signs for the verdicts, lines of equal clearance, MI and T_th marked.
Status draw_range(const RangeOutcome& outcome, const std::filesystem::path& png);

}  // namespace gnathion
