// How a run's steps are told and read back, for run_case.cc.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "pipeline/run_case.h"

namespace gnathion {

/// tracking.json: what became of the frames of each stream, and what tracking warned of.
nlohmann::json tracking_json(const SessionMotion& session);
/// Into session.ledger, full_searches and warnings, which motion.mcap does not hold.
Status read_tracking(const std::filesystem::path& path, SessionMotion& session);
/// "camera_0: 960 frames tracked, 0 missing, 0 rejected", for provenance.
std::vector<std::string> tracking_facts(const SessionMotion& session);

/// The bodies that a rig.toml names are inputs as it is.
Result<std::vector<StepInput>> rig_inputs(const std::filesystem::path& rig);

/// T_th.json into results.therapeutic; an unknown covariance is told by covariance_known.
Status read_position(const std::filesystem::path& path, CaseResults& results);

/// The step of frames.json: [[frame]] of case.toml with the files it names, and the dates of the scans, which
/// are their files' where case.toml gives none.
Result<StepSpec> frames_spec(const CaseFile& files, bool measured);

}  // namespace gnathion
