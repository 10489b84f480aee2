// What each step asks a daemon to compute, from what the case holds. Paths are inside the case's folder.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client/daemon_client.h"
#include "viewer/model/case_content.h"
#include "viewer/model/session_state.h"

namespace gnathion {

/// What the window does with a job's result.
enum class JobAfter { kReadCase, kTakeTransform, kShowVerdict };

struct DaemonTask {
  const char *object, *label, *tip;
  JobAfter after;
  /// Refused (kUsage) with what is missing. May write the window's T_th beside the outputs, for the job to
  /// read.
  Result<client::JobRequest> (*request)(const CaseContent&, const SessionState&);
};
const std::vector<DaemonTask>& daemon_tasks(Step step);

/// A full build into designs/NAME, with the parameters, edits and T_th of the window.
Result<client::JobRequest> design_request(const CaseContent& content, const SessionState& state);
/// The design of results/ against scans that lie in the case's folder.
Result<client::JobRequest> evaluate_request(const CaseContent& content, const std::filesystem::path& splint,
                                            const std::filesystem::path& maxilla,
                                            const std::filesystem::path& mandible);
/// The path that the request gives for its output.
std::string output_of(const client::JobRequest& request);
/// results/FILE, or what a job wrote later as jobs/STEM_nnn; results/FILE where there is neither.
std::filesystem::path newest_result(const std::filesystem::path& folder, const std::string& file,
                                    const std::string& stem, const std::string& extension);

}  // namespace gnathion
