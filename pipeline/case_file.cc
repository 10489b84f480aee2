#include "pipeline/case_file.h"

#include <fmt/format.h>

#include <map>

#include "core/file.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read case";
using Roles = std::map<std::string, std::filesystem::path*>;

Status take_files(const toml::table& table, const std::string& section, const Roles& roles, CaseFile& c) {
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    const auto role = roles.find(name);
    if (role == roles.end()) {
      if (section == "truth") continue;  // the phantom's own surfaces; nothing here needs them
      return bad_input(kWhat, c.toml().string(), fmt::format("unknown key '{}' in [{}]", name, section));
    }
    const auto value = node.value<std::string>();
    if (!value) return bad_input(kWhat, c.toml().string(), fmt::format("'{}' is not a path", name));
    *role->second = c.folder / *value;
    std::error_code ec;
    if (!std::filesystem::exists(*role->second, ec))
      return bad_input(kWhat, c.toml().string(),
                       fmt::format("'{}' names {}, which does not exist", name, *value));
  }
  return {};
}

}  // namespace

Result<CaseFile> read_case(const std::filesystem::path& folder, CaseTrust trust) {
  GNATHION_TRY(CaseFile c, read_unfinished_case(folder, trust));
  if (c.maxilla_mi.empty() || c.mandible_mi.empty())
    return bad_input(kWhat, c.toml().string(), "[scans] needs maxilla_mi and mandible_mi");
  return c;
}

Result<CaseFile> read_unfinished_case(const std::filesystem::path& folder, CaseTrust) {
  CaseFile c;
  c.folder = folder;
  GNATHION_TRY(const toml::table t, read_toml(c.toml(), kWhat));
  const std::map<std::string, Roles> sections = {
      {"scans",
       {{"maxilla_mi", &c.maxilla_mi},
        {"mandible_mi", &c.mandible_mi},
        {"maxilla_tp", &c.maxilla_tp},
        {"mandible_tp", &c.mandible_tp},
        {"mandible_clutch", &c.mandible_clutch},
        {"face_mi", &c.face_mi},
        {"face_tp", &c.face_tp}}},
      {"bodies", {{"bow", &c.bow_model}, {"head_frame", &c.head_frame_model}}},
      {"session", {{"rig", &c.rig}, {"recording", &c.recording}}},
      {"truth", {{"poses", &c.truth}}}};
  for (const auto& [key, node] : t) {
    const std::string name(key.str());
    if (name == "case" || name == "design" || name == "frame") continue;
    const auto section = sections.find(name);
    if (section == sections.end() || !node.is_table())
      return bad_input(kWhat, c.toml().string(), fmt::format("unknown section '{}'", name));
    GNATHION_CHECK_OK(take_files(*node.as_table(), name, section->second, c));
  }
  if (t.contains("design")) {
    GNATHION_TRY(c.parameters, read_parameters(c.toml()));
    GNATHION_TRY(const std::string text, read_file(c.toml()));
    GNATHION_TRY(c.edits, parse_edits(text, c.toml().string()));
  }
  c.kind = t["case"]["kind"].value_or(std::string("patient"));
  return c;
}

}  // namespace gnathion
