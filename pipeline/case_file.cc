#include "pipeline/case_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/file.h"
#include "pipeline/case_folder.h"
#include "pipeline/case_path.h"
#include "pipeline/case_roles.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot read case";

/// Fills a CaseFile from the sections of its TOML.
class Reader {
 public:
  Reader(CaseFile& c, CaseTrust trust) : c_(c), trust_(trust) {}

  Status read() {
    if (trust_ == CaseTrust::kConfined) {
      GNATHION_TRY(const CaseRoot root, CaseRoot::open(c_.folder));
      GNATHION_CHECK_OK(root.resolve("case.toml"));
      root_.emplace(root);
    }
    GNATHION_TRY(const toml::table t, read_toml(c_.toml(), kWhat));
    for (const auto& [key, node] : t) GNATHION_CHECK_OK(take(std::string(key.str()), node));
    if (t.contains("design")) {
      GNATHION_TRY(c_.parameters, read_parameters(c_.toml()));
      GNATHION_TRY(const std::string text, read_file(c_.toml()));
      GNATHION_TRY(c_.edits, parse_edits(text, c_.toml().string()));
    }
    if (c_.id.empty()) c_.id = id_of_folder();
    if (trust_ == CaseTrust::kConfined) GNATHION_CHECK_OK(confine_rig());
    return {};
  }

 private:
  tl::unexpected<Error> bad(const std::string& why) const {
    return bad_input(kWhat, c_.toml().string(), why);
  }

  Status take(const std::string& name, const toml::node& node) {
    if (name == "design") return node.is_table() ? Status() : bad("'design' is not a section");
    if (name == "frame") return confine_frames(node);
    if (name == "plane") return take_planes(node);
    const toml::table* table = node.as_table();
    if (name == "case" || name == "patient") {
      if (table == nullptr) return bad(fmt::format("'{}' is not a section", name));
      return name == "case" ? take_case(*table) : take_patient(*table);
    }
    const auto& roles = case_roles();
    const bool known = name == "extra" || std::any_of(roles.begin(), roles.end(),
                                                      [&](const CaseRole& r) { return name == r.section; });
    if (!known || table == nullptr) return bad(fmt::format("unknown section '{}'", name));
    return take_files(*table, name);
  }

  Status text_of(const toml::table& table, const char* key, std::string& to) const {
    const toml::node* node = table.get(key);
    if (node == nullptr) return {};
    const auto value = node->value<std::string>();
    if (!value) return bad(fmt::format("'{}' is not a text in quotes", key));
    to = *value;
    return {};
  }

  Status known_keys(const toml::table& table, const char* section,
                    std::initializer_list<const char*> keys) const {
    for (const auto& [key, node] : table)
      if (std::find(keys.begin(), keys.end(), key.str()) == keys.end())
        return bad(fmt::format("unknown key '{}' in [{}]", std::string(key.str()), section));
    return {};
  }

  Status take_case(const toml::table& table) {
    GNATHION_CHECK_OK(known_keys(table, "case", {"id", "kind", "created", "seed", "remarks"}));
    GNATHION_CHECK_OK(text_of(table, "id", c_.id));
    GNATHION_CHECK_OK(text_of(table, "kind", c_.kind));
    GNATHION_CHECK_OK(text_of(table, "created", c_.created));
    if (c_.kind != "patient" && c_.kind != "phantom")
      return bad(fmt::format("kind '{}' is neither \"patient\" nor \"phantom\"", c_.kind));
    if (!c_.id.empty())
      if (const Status s = check_case_id(c_.id); !s) return bad("id: " + s.error().why);
    return {};
  }

  Status take_patient(const toml::table& table) {
    GNATHION_CHECK_OK(known_keys(table, "patient", {"name", "number", "born", "sex", "remarks"}));
    PatientIdentity& p = c_.patient;
    for (const auto& [key, to] :
         {std::pair{"name", &p.name}, {"number", &p.number}, {"sex", &p.sex}, {"remarks", &p.remarks}})
      GNATHION_CHECK_OK(text_of(table, key, *to));
    if (const auto date = table["born"].value<toml::date>())
      p.born = fmt::format("{:04}-{:02}-{:02}", date->year, static_cast<int>(date->month),
                           static_cast<int>(date->day));
    else
      GNATHION_CHECK_OK(text_of(table, "born", p.born));
    return {};
  }

  Status take_files(const toml::table& table, const std::string& section) {
    for (const auto& [key, node] : table) {
      const std::string name(key.str());
      const auto& roles = case_roles();
      const auto role = std::find_if(roles.begin(), roles.end(), [&](const CaseRole& r) {
        return section == r.section && name == r.key;
      });
      if (role == roles.end() && section == "truth")
        continue;  // the phantom's surfaces; nothing here needs them
      if (role == roles.end() && section != "extra")
        return bad(fmt::format("unknown key '{}' in [{}]", name, section));
      const auto value = node.value<std::string>();
      if (!value || value->empty()) return bad(fmt::format("'{}' is not a path", name));
      GNATHION_TRY(fs::path path, file_at(name, *value));
      (section == "extra" ? c_.extra[name] : c_.*(role->member)) = std::move(path);
    }
    return {};
  }

  Result<fs::path> file_at(const std::string& name, const std::string& written) const {
    if (root_) {
      auto inside = root_->resolve(written);
      if (!inside) return bad(fmt::format("'{}' names {}: {}", name, written, inside.error().why));
      return inside;
    }
    const fs::path path = c_.folder / written;
    std::error_code ec;
    if (!fs::exists(path, ec)) return bad(fmt::format("'{}' names {}, which does not exist", name, written));
    return path;
  }

  /// Files that [[frame]] names; what else is in it frames_steps.cc reads.
  Status confine_frames(const toml::node& node) const {
    const toml::array* frames = node.as_array();
    if (frames == nullptr) return bad("'frame' is not [[frame]]");
    for (const toml::node& frame : *frames) {
      if (!frame.is_table()) return bad("'frame' is not [[frame]]");
      for (const char* key : {"transform", "scan"})
        if (const auto written = (*frame.as_table())[key].value<std::string>())
          GNATHION_CHECK_OK(file_at(key, *written));
    }
    return {};
  }

  /// The bodies that a rig names lie beside it, and inside the case.
  Status confine_rig() const {
    if (c_.rig.empty()) return {};
    GNATHION_TRY(const toml::table rig, read_toml(c_.rig, kWhat));
    const fs::path beside = c_.rig.parent_path();
    for (const char* key : {"bow", "head_frame"})
      if (const auto written = rig[key].value<std::string>()) {
        const auto inside = root_->resolve((beside / *written).string());
        if (!inside)
          return bad_input(kWhat, c_.rig.string(),
                           fmt::format("'{}' names {}: {}", key, *written, inside.error().why));
      }
    return {};
  }

  Status take_planes(const toml::node& node) {
    const toml::array* planes = node.as_array();
    if (planes == nullptr) return bad("'plane' is not [[plane]]");
    for (const toml::node& entry : *planes) {
      if (!entry.is_table()) return bad("'plane' is not [[plane]]");
      const toml::table& table = *entry.as_table();
      GNATHION_CHECK_OK(known_keys(table, "plane", {"name", "centre_mm", "normal", "size_mm"}));
      CasePlane plane;
      GNATHION_CHECK_OK(text_of(table, "name", plane.name));
      GNATHION_CHECK_OK(three(table, "centre_mm", plane.centre_mm));
      GNATHION_CHECK_OK(three(table, "normal", plane.normal));
      plane.size_mm = table["size_mm"].value_or(0.0);
      c_.planes.push_back(plane);
    }
    return {};
  }

  Status three(const toml::table& table, const char* key, std::array<double, 3>& to) const {
    const toml::array* numbers = table[key].as_array();
    if (numbers == nullptr || numbers->size() != 3)
      return bad(fmt::format("[[plane]]: '{}' is not 3 numbers", key));
    for (std::size_t i = 0; i < 3; ++i) {
      const auto value = (*numbers)[i].value<double>();
      if (!value || !std::isfinite(*value)) return bad(fmt::format("[[plane]]: '{}' is not 3 numbers", key));
      to[i] = *value;
    }
    return {};
  }

  /// Cases of old have no id: their folder's name, as far as it is one.
  std::string id_of_folder() const {
    std::error_code ec;
    std::string name = fs::weakly_canonical(fs::absolute(c_.folder, ec), ec).filename().string();
    for (char& ch : name)
      if (!std::isalnum(static_cast<unsigned char>(ch)) && ch != '.' && ch != '-' && ch != '_') ch = '_';
    while (!name.empty() && (name.front() == '.' || name.front() == '-')) name.erase(0, 1);
    name.resize(std::min<std::size_t>(name.size(), 64));
    return name.empty() ? "case" : name;
  }

  CaseFile& c_;
  CaseTrust trust_;
  std::optional<CaseRoot> root_;
};

}  // namespace

Result<CaseFile> read_unfinished_case(const fs::path& folder, CaseTrust trust) {
  CaseFile c;
  c.folder = folder;
  c.kind = "patient";
  GNATHION_CHECK_OK(Reader(c, trust).read());
  return c;
}

Result<CaseFile> read_case(const fs::path& folder, CaseTrust trust) {
  GNATHION_TRY(CaseFile c, read_unfinished_case(folder, trust));
  if (c.maxilla_mi.empty() || c.mandible_mi.empty())
    return bad_input(kWhat, c.toml().string(), "[scans] needs maxilla_mi and mandible_mi");
  return c;
}

}  // namespace gnathion
