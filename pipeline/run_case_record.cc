#include "pipeline/run_case_record.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "core/transform_io.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace fs = std::filesystem;
using nlohmann::json;

bool CaseDesign::accepted() const {
  return report && report->contains("verdict") && (*report)["verdict"] == "pass";
}

json tracking_json(const SessionMotion& session) {
  std::size_t valid = 0;
  for (const MotionRow& row : session.rows) valid += row.valid();
  json ledger = json::object();
  for (const auto& [stream, l] : session.ledger)
    ledger[stream] = {
        {"frames", l.frames}, {"missing", l.missing}, {"rejected", l.rejected}, {"ignored", l.ignored}};
  return {{"kind", "tracking"}, {"rows", session.rows.size()},
          {"valid", valid},     {"full_searches", session.full_searches},
          {"ledger", ledger},   {"warnings", session.warnings}};
}

Status read_tracking(const fs::path& path, SessionMotion& session) {
  GNATHION_TRY(const json j, read_json(path));
  try {
    session.full_searches = j.at("full_searches").get<std::size_t>();
    session.warnings = j.at("warnings").get<std::vector<std::string>>();
    for (const auto& [stream, l] : j.at("ledger").items())
      session.ledger[stream] = {l.at("frames").get<std::size_t>(), l.at("missing").get<std::size_t>(),
                                l.at("rejected").get<std::size_t>(), l.at("ignored").get<std::size_t>()};
  } catch (const json::exception& e) {
    return bad_input("cannot read tracking", path.string(), e.what());
  }
  return {};
}

std::vector<std::string> tracking_facts(const SessionMotion& session) {
  std::vector<std::string> facts;
  for (const auto& [stream, l] : session.ledger)
    facts.push_back(fmt::format("{}: {} frames tracked, {} missing, {} rejected", stream, l.frames, l.missing,
                                l.rejected));
  return facts;
}

Result<std::vector<StepInput>> rig_inputs(const fs::path& rig) {
  GNATHION_TRY(const toml::table t, read_toml(rig, "cannot read rig"));
  std::vector<StepInput> inputs;
  for (const char* key : {"bow", "head_frame"})
    if (const auto name = t[key].value<std::string>())
      inputs.push_back({std::string("rig.") + key, rig.parent_path() / *name});
  return inputs;
}

Status read_position(const fs::path& path, CaseResults& results) {
  GNATHION_TRY(const MotionFile read, read_motion(path));
  results.therapeutic.therapeutic.value = read.motion;
  results.covariance_known = read.covariance.has_value();
  results.therapeutic.therapeutic.covariance = read.covariance.value_or(Matrix6::Zero());
  return {};
}

Result<StepSpec> frames_spec(const CaseFile& files, bool measured) {
  StepSpec spec{"frames",
                1,
                {{"scans.maxilla_mi", files.maxilla_mi},
                 {"scans.mandible_mi", files.mandible_mi},
                 {"scans.maxilla_tp", files.maxilla_tp},
                 {"scans.mandible_tp", files.mandible_tp}},
                {{"position", "T_th.json"}},
                ""};
  if (measured) spec.uses.emplace_back("chain", "chain.json");
  // When files were written is told in the result and is no part of the key: a case that was copied is the
  // same.
  json parameters = json::object();
  GNATHION_TRY(const toml::table t, read_toml(files.toml(), "cannot read case"));
  if (const toml::array* frames = t["frame"].as_array()) {
    std::ostringstream text;
    text << toml::json_formatter(*frames);
    parameters["frame"] = json::parse(text.str(), nullptr, false);
    std::size_t n = 0;
    for (const auto& node : *frames) {
      ++n;
      if (!node.is_table()) continue;
      for (const char* key : {"transform", "scan"})
        if (const auto name = (*node.as_table())[key].value<std::string>()) {
          spec.inputs.push_back({fmt::format("frame {}.{}", n, key), files.folder / *name});
        }
    }
  }
  spec.parameters = parameters.dump();
  return spec;
}

}  // namespace gnathion
