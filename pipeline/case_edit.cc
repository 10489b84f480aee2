#include "pipeline/case_edit.h"

#include <fmt/format.h>

#include <cctype>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "pipeline/case_private.h"
#include "pipeline/case_roles.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot add to case";

std::string extension_of(const fs::path& path) {
  std::string ext = path.extension().string();
  for (char& c : ext) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return ext;
}

/// The bodies that a rig.toml names beside it travel with it.
Result<std::vector<std::string>> bodies_of_rig(const fs::path& rig) {
  GNATHION_TRY(const toml::table t, read_toml(rig, kWhat));
  std::vector<std::string> names;
  for (const char* key : {"bow", "head_frame"})
    if (const auto name = t[key].value<std::string>()) {
      if (fs::path(*name).filename() != *name || *name == "..")
        return bad_input(kWhat, rig.string(), fmt::format("its {} must lie beside it", key));
      std::error_code ec;
      if (!fs::is_regular_file(fs::symlink_status(rig.parent_path() / *name, ec)))
        return bad_input(kWhat, rig.string(), fmt::format("its {} {} is not beside it", key, *name));
      names.push_back(*name);
    }
  return names;
}

/// Where a line starts in the text; lines count from 1.
std::size_t start_of_line(const std::string& text, std::size_t line) {
  std::size_t at = 0;
  for (std::size_t n = 1; n < line; ++n) {
    const std::size_t end = text.find('\n', at);
    if (end == std::string::npos) return text.size();
    at = end + 1;
  }
  return at;
}

std::string first_word(const std::string& line) {
  const std::size_t a = line.find_first_not_of(" \t");
  if (a == std::string::npos) return "";
  return line.substr(a, line.find_first_of(" \t=", a) - a);
}

}  // namespace

Result<CaseEdit> CaseEdit::open(const fs::path& folder) {
  GNATHION_TRY(const CaseFile readable, read_unfinished_case(folder));
  GNATHION_TRY(std::string text, read_file(folder / "case.toml"));
  if (!text.empty() && text.back() != '\n') text += '\n';
  return CaseEdit(folder, std::move(text));
}

Status CaseEdit::check(const NewCaseFile& file, bool force) const {
  const CaseRole* role = find_case_role(file.role);
  const bool extra = file.role.rfind("extra.", 0) == 0;
  if (role == nullptr && !extra)
    return fail(ErrorCode::kUsage, kWhat, file.role, "is no role; `gnathion case info --roles` lists them");
  if (extra) {
    GNATHION_CHECK_OK(check_case_id(file.role.substr(6)));
    if (file.role.find('.', 6) != std::string::npos)
      return fail(ErrorCode::kUsage, kWhat, file.role, "a name under 'extra' holds no dot");
  }
  GNATHION_TRY(const CaseFile now, read_unfinished_case(folder_));
  if (role != nullptr && !(now.*(role->member)).empty() && !force)
    return fail(ErrorCode::kUsage, kWhat, file.role, "is in the case already; --force replaces it");
  std::error_code ec;
  if (!fs::exists(file.from, ec)) return bad_input(kWhat, file.from.string(), "does not exist");
  if (role == nullptr) return {};
  if (role->kind != CaseFileKind::kVolume && !fs::is_regular_file(file.from, ec))
    return bad_input(kWhat, file.from.string(), "is not a file");
  switch (role->kind) {
    case CaseFileKind::kMesh: {
      GNATHION_TRY(const TriangleMesh mesh, read_mesh(file.from));
      return {};
    }
    case CaseFileKind::kToml: {
      GNATHION_TRY(const auto bodies, bodies_of_rig(file.from));
      return {};
    }
    case CaseFileKind::kTransform: {
      GNATHION_TRY(const MotionFile motion, read_motion(file.from));
      return {};
    }
    default:
      return {};
  }
}

Status CaseEdit::add(const NewCaseFile& file) {
  const CaseRole* role = find_case_role(file.role);
  const std::string key = role != nullptr ? role->key : file.role.substr(6);
  const std::string sub = role != nullptr ? role->folder : "extra";
  std::error_code ec;
  fs::create_directory(folder_ / sub, ec);
  if (ec) return fail(ErrorCode::kInternal, kWhat, (folder_ / sub).string(), ec.message());
  GNATHION_CHECK_OK(make_private(folder_ / sub));
  const fs::path place = fs::path(sub) / (key + extension_of(file.from));
  GNATHION_CHECK_OK(copy_private(file.from, folder_ / place));
  if (role != nullptr && role->kind == CaseFileKind::kToml) {
    GNATHION_TRY(const auto bodies, bodies_of_rig(file.from));
    for (const std::string& body : bodies)
      GNATHION_CHECK_OK(copy_private(file.from.parent_path() / body, folder_ / sub / body, LinkUse::kRefuse));
  }
  return set(role != nullptr ? role->section : "extra", key, toml_quoted(place.generic_string()));
}

Status CaseEdit::set(const std::string& section, const std::string& key, const std::string& toml_value) {
  toml::parse_result parsed = toml::parse(text_);
  if (!parsed)
    return bad_input(kWhat, (folder_ / "case.toml").string(), std::string(parsed.error().description()));
  const toml::table t = std::move(parsed).table();
  const std::string line = key + " = " + toml_value + "\n";
  const toml::table* table = t[section].as_table();
  if (table == nullptr) {
    text_ += "\n[" + section + "]\n" + line;
    return {};
  }
  if (const toml::node* node = table->get(key)) {
    const std::size_t at = start_of_line(text_, node->source().begin.line);
    const std::size_t end = text_.find('\n', at);
    if (first_word(text_.substr(at, end - at)) != key || node->source().end.line != node->source().begin.line)
      return bad_input(
          kWhat, (folder_ / "case.toml").string(),
          fmt::format("'{}' in [{}] is written in a way that only a person can change", key, section));
    text_.replace(at, end + 1 - at, line);
    return {};
  }
  const std::size_t at = start_of_line(text_, table->source().begin.line);
  const std::size_t end = text_.find('\n', at);
  if (text_.compare(at, section.size() + 2, "[" + section + "]") != 0)
    return bad_input(kWhat, (folder_ / "case.toml").string(),
                     fmt::format("[{}] is written in a way that only a person can add to", section));
  text_.insert(end + 1, line);
  return {};
}

Status CaseEdit::commit() {
  const toml::parse_result parsed = toml::parse(text_);
  if (!parsed)
    return fail(ErrorCode::kInternal, kWhat, (folder_ / "case.toml").string(),
                std::string(parsed.error().description()));
  return write_private(folder_ / "case.toml", text_);
}

}  // namespace gnathion
