// Where a recording goes, and how it is found again after a crash.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "daemon/api_error.h"
#include "daemon/config.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

struct RecordingPlace {
  std::filesystem::path file;
  std::string inside_case;  ///< "recordings/recording_001.mcap"
};

/// Makes CASE/recordings if need be. An empty name: the next "recording_NNN".
ApiResult<RecordingPlace> place_for_recording(const CaseRoot& root, const std::string& case_id,
                                              const std::string& name);

/// case.toml's [session] recording names it from now on, in place of one that lies in recordings/ too: `run`
/// takes the newest. False: something works in the case, try again later. Refused (kGate): case.toml names a
/// recording from elsewhere, which stays.
Result<bool> enter_recording(const CaseRoot& root, const std::string& case_id,
                             const std::string& inside_case);

/// False: the error may pass (a full disk): try again. Else this recording will never be entered.
bool is_final(const Error& not_entered);
/// Why, for the log and the audit trail: without names of files, which may be a person's.
std::string why_not_entered(const Error& error);

/// A note in the state folder that this file is being written: after a crash it is there.
Status note_running_recording(const DaemonConfig& config, const CaseRoot& root,
                              const std::filesystem::path& file);
void forget_running_recording(const DaemonConfig& config);

/// Recordings, by case, that are whole but not yet in case.toml, since something works in the case or the
/// disk is full: a note in the state folder, so that neither a crash nor a restart loses them. False: it
/// cannot be written, which the log tells.
bool note_waiting_recordings(const DaemonConfig& config, const std::map<std::string, std::string>& by_case);
std::map<std::string, std::string> waiting_recordings(const DaemonConfig& config);

}  // namespace gnathion::daemon
