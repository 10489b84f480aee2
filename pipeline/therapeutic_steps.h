// From scans and jaw positions to T_th, by each route, compared and fused.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calibration/chain.h"
#include "calibration/chain_json.h"
#include "calibration/composition.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform_io.h"
#include "tracking/plateaus.h"
#include "tracking/slip.h"

namespace gnathion {

/// Files of solve_chain's scans; face scans in both positions or none. The head frame's model steadies the
/// head between the face scans, where soft tissue does not.
struct ChainFiles {
  std::filesystem::path mandible_mi, bow_model, head_frame_model;
  std::vector<std::filesystem::path> clutch_scans, faces_mi, faces_tp;
};
Result<ChainScans> read_chain_scans(const ChainFiles& files);

/// MI and TP of a session. Errors (kInput): the jaw moves in one of them, or they overlap.
Result<JawPositions> resting_positions(const SessionMotion& session, const PlateauOptions& options);

/// T_th by the camera route.
struct CameraRoute {
  JawPositions positions;
  std::vector<std::string>
      slips;  ///< between which rests of MI something slipped, and what, where it can be told
  TherapeuticEstimate estimate;
};
Result<CameraRoute> camera_route(const SessionMotion& session, const ChainPose& bow_from_dental,
                                 const PlateauOptions& options);

/// "source" of a T_th.json of the camera route: positions, dispersion, closures.
nlohmann::json camera_route_source(const CameraRoute& route);
/// Which MI recordings are apart, by how much; of a route also what slipped.
std::string closure_text(const JawPositions& positions);
std::string closure_text(const CameraRoute& route);
/// A motion for people: rotation angle, and the displacement of the frame's origin.
std::string motion_text(const Motion<Dental>& motion);

}  // namespace gnathion
