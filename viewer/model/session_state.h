// What the user decides about a case: everything that undo takes back, and that is kept on close.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "core/rigid.h"
#include "design/edits.h"
#include "design/parameters.h"
#include "occlusion/arch.h"

namespace gnathion {

struct SessionState {
  std::optional<Rigid3> therapeutic;  ///< T_th; nothing: not known yet
  std::string therapeutic_source;     ///< "T_th.json", "sliders", "motion at 3.25 s"
  SplintParameters parameters;
  SplintEdits edits;
  Arch arch = Arch::kMaxilla;                           ///< that wears the splint
  std::optional<std::pair<double, double>> mi_s, tp_s;  ///< picked on the timeline
};

/// As case.toml has them, so that they can be taken over there, and as `--config` of the command line reads.
std::string edits_toml(const SplintEdits& edits);
/// CASE/viewer.json: {"kind":"viewer","unit":"mm","therapeutic":{…},"parameters":{…},"edits":{…},…}.
nlohmann::json session_json(const SessionState& state);
/// Over `base`. Refused (kInput): what is not such a file, values out of range.
Result<SessionState> session_from_json(const nlohmann::json& j, SessionState base);

}  // namespace gnathion
