#include "daemon/recording_place.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "acquisition/recording.h"
#include "core/file.h"
#include "core/log.h"
#include "daemon/session_control.h"
#include "pipeline/case_edit.h"
#include "pipeline/case_file.h"
#include "pipeline/case_lock.h"
#include "pipeline/case_private.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;

fs::path note_file(const DaemonConfig& config) {
  return config.state / "running_recording.json";
}

fs::path waiting_file(const DaemonConfig& config) {
  return config.state / "waiting_recordings.json";
}

bool is_recording_name(const std::string& name) {
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
}

/// The number after the highest there is: a name is never used twice.
std::string next_name(const fs::path& folder) {
  int last = 0;
  std::error_code ec;
  for (const auto& entry : fs::directory_iterator(folder, ec)) {
    const std::string stem = entry.path().stem().string();
    if (stem.rfind("recording_", 0) == 0) last = std::max(last, std::atoi(stem.c_str() + 10));
  }
  return fmt::format("recording_{:03d}", last + 1);
}

/// For a line of the log: what became of entering a recording that a crash had cut off. `shown` begins with
/// the case's folder. The note of a running recording goes when it is needed no more.
std::string entered(const DaemonConfig& config, const CaseRoot& root, const std::string& shown) {
  const std::size_t slash = shown.find('/');
  if (slash == std::string::npos) {
    forget_running_recording(config);
    return {};
  }
  const std::string case_id = shown.substr(0, slash), inside = shown.substr(slash + 1);
  const auto done = enter_recording(root, case_id, inside);
  auto waiting = waiting_recordings(config);
  waiting.erase(case_id);  // an older one
  const bool waits = done ? !*done : !is_final(done.error());
  if (waits) waiting[case_id] = inside;
  const bool noted = note_waiting_recordings(config, waiting);
  if (noted || !waits) forget_running_recording(config);
  if (!done) return "; " + why_not_entered(done.error());
  return *done ? "" : "; case.toml will name it when what works in the case has ended";
}

}  // namespace

ApiResult<RecordingPlace> place_for_recording(const CaseRoot& root, const std::string& case_id,
                                              const std::string& name) {
  if (!name.empty() && !is_recording_name(name))
    return refuse(
        ApiCode::kInvalidArgument,
        "a recording's name is 1 to 64 letters, digits, '_' or '-'; leave it empty to have one made");
  const auto folder = root.case_folder(case_id);
  if (!folder) return refuse(ApiCode::kNotFound, folder.error().line());
  std::error_code ec;
  fs::create_directory(*folder / "recordings", ec);
  const auto recordings = root.resolve((*folder / "recordings").string());
  if (!recordings) return refuse(ApiCode::kPermissionDenied, recordings.error().line());
  RecordingPlace place;
  place.inside_case = fmt::format("recordings/{}.mcap", name.empty() ? next_name(*recordings) : name);
  const auto file = root.resolve((*folder / place.inside_case).string(), PathUse::kNew);
  if (!file) return refuse(ApiCode::kPermissionDenied, file.error().line());
  if (fs::exists(*file, ec))
    return refuse(ApiCode::kAlreadyExists,
                  fmt::format("{} is there already: choose another name", place.inside_case));
  place.file = *file;
  return place;
}

Result<bool> enter_recording(const CaseRoot& root, const std::string& case_id,
                             const std::string& inside_case) {
  constexpr const char* what = "cannot enter recording in case.toml";
  GNATHION_TRY(const fs::path folder, root.case_folder(case_id));
  const auto lock = CaseLock::take(folder, what);
  if (!lock && lock.error().code == ErrorCode::kUsage) return false;
  if (!lock) return tl::unexpected<Error>(lock.error());
  GNATHION_TRY(const CaseFile files, read_unfinished_case(folder, CaseTrust::kConfined));
  if (!files.recording.empty() && files.recording.parent_path() != folder / "recordings")
    return fail(ErrorCode::kGate, what, inside_case,
                files.recording.filename().string() + " stays the recording that case.toml names");
  GNATHION_TRY(CaseEdit edit, CaseEdit::open(folder));
  GNATHION_CHECK_OK(edit.set("session", "recording", toml_quoted(inside_case)));
  GNATHION_CHECK_OK(edit.commit());
  return true;
}

bool is_final(const Error& not_entered) {
  return not_entered.code != ErrorCode::kInternal;
}

std::string why_not_entered(const Error& error) {
  if (error.code == ErrorCode::kGate) return "case.toml names another recording, which stays";
  if (is_final(error)) return "it cannot be entered in case.toml: `gnathion case info` tells why";
  return "it will be entered in case.toml when that can be written: " + error.why;
}

Status note_running_recording(const DaemonConfig& config, const CaseRoot& root, const fs::path& file) {
  const nlohmann::json note = {{"recording", fs::relative(file, root.path()).string()}};
  return write_file(note_file(config), note.dump() + "\n");
}

void forget_running_recording(const DaemonConfig& config) {
  std::error_code ec;
  fs::remove(note_file(config), ec);
}

bool note_waiting_recordings(const DaemonConfig& config, const std::map<std::string, std::string>& by_case) {
  std::error_code ec;
  if (by_case.empty()) {
    fs::remove(waiting_file(config), ec);
    return !ec;
  }
  const Status written = write_file(waiting_file(config), nlohmann::json(by_case).dump() + "\n");
  if (!written) log(LogLevel::kError, written.error().line());
  return written.has_value();
}

std::map<std::string, std::string> waiting_recordings(const DaemonConfig& config) {
  std::map<std::string, std::string> by_case;
  const auto text = read_file(waiting_file(config));
  const auto note = text ? nlohmann::json::parse(*text, nullptr, false) : nlohmann::json();
  if (!note.is_object()) return by_case;
  for (const auto& [case_id, file] : note.items())
    if (file.is_string()) by_case[case_id] = file.get<std::string>();
  return by_case;
}

std::vector<std::string> recover_after_crash(const DaemonConfig& config, const CaseRoot& root) {
  std::error_code ec;
  const auto text = read_file(note_file(config));
  if (!text) return {};
  const auto note = nlohmann::json::parse(*text, nullptr, false);
  if (!note.is_object() || !note.contains("recording") || !note["recording"].is_string()) {
    forget_running_recording(config);
    return {
        "the note of a running recording cannot be read; `gnathion recording verify` shows what is whole"};
  }
  const std::string shown = note["recording"].get<std::string>();
  const auto file = root.resolve(shown);
  if (!file) {  // the crash came before the file was made
    forget_running_recording(config);
    return {};
  }
  const auto found = summarise_recording(*file);
  if (found && found->whole) {
    const std::string line =
        shown + " was complete when the daemon was killed" + entered(config, root, shown);
    return {line};
  }
  const fs::path whole = file->string() + ".recovered";
  fs::remove(whole, ec);
  const auto lost = recover_recording(*file, whole);
  if (!lost) {  // nothing in it: cut off before its first chunk
    fs::remove(whole, ec);
    if (fs::file_size(*file, ec) < 4096) fs::remove(*file, ec);
    forget_running_recording(config);
    return {fmt::format("{} cannot be recovered: {}", shown, lost.error().line())};
  }
  fs::rename(whole, *file, ec);
  if (ec) return {fmt::format("{} cannot be replaced by what was recovered: {}", shown, ec.message())};
  const std::string line =
      fmt::format("{} was cut off and has been recovered; {} samples are known to be missing{}", shown, *lost,
                  entered(config, root, shown));
  return {line};
}

}  // namespace gnathion::daemon
