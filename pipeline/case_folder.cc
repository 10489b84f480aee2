#include "pipeline/case_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "core/file.h"
#include "core/transform_io.h"
#include "core/utc.h"
#include "pipeline/case_edit.h"
#include "pipeline/case_lock.h"
#include "pipeline/case_private.h"
#include "pipeline/case_roles.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot create case";

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

/// Words of a name, and numbers, that would tell from an id who the patient is.
Status id_hides_patient(const std::string& id, const PatientIdentity& patient) {
  const std::string low = lower(id);
  std::string word;
  const auto tells = [&](const std::string& w) { return w.size() >= 3 && low.find(w) != std::string::npos; };
  for (const char c : lower(patient.name) + " ") {
    if (std::isalnum(static_cast<unsigned char>(c)) || static_cast<unsigned char>(c) >= 0x80) {
      word += c;
      continue;
    }
    if (tells(word))
      return fail(ErrorCode::kUsage, kWhat, "the id",
                  "holds a part of the patient's name; ids go into logs and exports, choose another");
    word.clear();
  }
  if (tells(lower(patient.number)))
    return fail(ErrorCode::kUsage, kWhat, "the id",
                "holds the patient's number; ids go into logs and exports, choose another");
  return {};
}

std::string patient_section(const PatientIdentity& p) {
  std::string text =
      "\n[patient]          # who it is stands here and nowhere else: no result, log or export has it\n";
  for (const auto& [key, value] : {std::pair{"name", p.name},
                                   {"number", p.number},
                                   {"born", p.born},
                                   {"sex", p.sex},
                                   {"remarks", p.remarks}})
    if (!value.empty()) text += fmt::format("{} = {}\n", key, toml_quoted(value));
  return text;
}

std::string new_case_toml(const NewCase& what, const std::string& created) {
  std::string text = fmt::format(
      "# A case of Gnathion: one patient, one session. Paths are relative to this file; meshes are in\n"
      "# millimetres. docs/cases.md tells every key.\n\n[case]\nid = {}\nkind = {}\ncreated = {}\n",
      toml_quoted(what.id), toml_quoted(what.kind), toml_quoted(created));
  if (!what.patient.empty()) text += patient_section(what.patient);
  return text + what.more_toml;
}

std::string verdict_of(const fs::path& folder) {
  const auto design = read_json(folder / "results" / "design.json");
  if (!design || !design->is_object() || !design->contains("verdict") || !(*design)["verdict"].is_string())
    return "";
  return (*design)["verdict"].get<std::string>();
}

std::string results_time(const fs::path& folder) {
  const auto run = read_json(folder / "results" / "provenance.json");
  if (!run || !run->is_object() || !run->contains("time") || !(*run)["time"].is_string()) return "";
  return (*run)["time"].get<std::string>();
}

std::uint64_t size_of(const fs::path& path) {
  std::error_code ec;
  if (!fs::is_directory(path, ec)) {
    const auto bytes = fs::file_size(path, ec);
    return ec ? 0 : bytes;
  }
  std::uint64_t sum = 0;
  for (auto it = fs::recursive_directory_iterator(path, ec); !ec && it != fs::recursive_directory_iterator();
       it.increment(ec)) {
    std::error_code one;
    if (it->is_regular_file(one)) sum += it->file_size(one);
  }
  return sum;
}

}  // namespace

Status check_case_id(std::string_view id) {
  const auto bad = [&](const char* why) {
    return fail(ErrorCode::kUsage, "not a case id", std::string(id.substr(0, 80)), why);
  };
  if (id.empty() || id.size() > 64) return bad("1 to 64 characters are needed");
  if (id.front() == '.' || id.front() == '-') return bad("it may not begin with a dot or a dash");
  for (const char c : id)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '_' && c != '-')
      return fail(ErrorCode::kUsage, "not a case id", "the id given",
                  "only letters A-Z a-z, digits, '.', '_' and '-' are allowed");
  return {};
}

Result<CaseFile> create_case(const fs::path& folder, const NewCase& what, Clock& clock) {
  GNATHION_CHECK_OK(check_case_id(what.id));
  GNATHION_CHECK_OK(id_hides_patient(what.id, what.patient));
  if (what.kind != "patient" && what.kind != "phantom")
    return fail(ErrorCode::kUsage, kWhat, what.kind, "kind is \"patient\" or \"phantom\"");
  static std::mutex one_at_a_time;  // the staging place is one a process
  const std::scoped_lock lock(one_at_a_time);
  GNATHION_TRY(const StagedDirectory staged, StagedDirectory::create(folder, false));
  GNATHION_CHECK_OK(make_private(staged.path()));
  GNATHION_CHECK_OK(write_private(staged.path() / "case.toml", new_case_toml(what, utc_text(clock.now()))));
  GNATHION_CHECK_OK(add_case_files(staged.path(), what.files, false));
  GNATHION_TRY(const CaseFile checked, read_unfinished_case(staged.path()));
  fs::path target = folder.lexically_normal();
  if (!target.has_filename()) target = target.parent_path();
  GNATHION_CHECK_OK(rename_to_free(staged.path(), target));
  return read_unfinished_case(target);
}

Status add_case_files(const fs::path& folder, const std::vector<NewCaseFile>& files, bool force) {
  GNATHION_TRY(const CaseLock lock, CaseLock::take(folder, "cannot add to case"));
  GNATHION_TRY(CaseEdit edit, CaseEdit::open(folder));
  std::set<std::string> named;
  for (const NewCaseFile& file : files) {
    if (!named.insert(file.role).second)
      return fail(ErrorCode::kUsage, "cannot add to case", file.role, "is given twice");
    GNATHION_CHECK_OK(edit.check(file, force));
  }
  for (const NewCaseFile& file : files) GNATHION_CHECK_OK(edit.add(file));
  return edit.commit();
}

std::vector<CaseFileEntry> case_files(const CaseFile& files) {
  std::vector<CaseFileEntry> out;
  const auto add = [&](const std::string& role, const fs::path& path) {
    if (path.empty()) return;
    const fs::path relative = path.lexically_relative(files.folder);
    const bool inside = !relative.empty() && *relative.begin() != "..";
    out.push_back({role, path, inside ? relative.generic_string() : path.generic_string(), size_of(path)});
  };
  for (const CaseRole& role : case_roles()) add(role.name(), files.*(role.member));
  for (const auto& [name, path] : files.extra) add("extra." + name, path);
  return out;
}

CaseSummary summarize_case(const fs::path& folder, CaseTrust trust) {
  CaseSummary s;
  s.folder = folder;
  s.id = folder.filename().string();
  if (const auto sha = sha256_of_file(folder / "case.toml")) s.toml_sha256 = *sha;
  const auto c = read_unfinished_case(folder, trust);
  if (!c) {
    s.problem = c.error().line();
    return s;
  }
  s.id = c->id;
  s.kind = c->kind;
  s.created = c->created;
  s.files = case_files(*c);
  s.verdict = verdict_of(folder);
  s.results_at = results_time(folder);
  // Under a daemon's root a case is found by its folder, and named by its id.
  if (const std::string name = folder.filename().string(); trust == CaseTrust::kConfined && s.id != name)
    s.problem =
        fmt::format("case.toml says that it is '{}', its folder is called '{}': give both the same name",
                    s.id.substr(0, 80), name.substr(0, 80));
  return s;
}

Result<std::vector<CaseSummary>> list_cases(const fs::path& root, CaseTrust trust) {
  std::error_code ec;
  std::vector<CaseSummary> all;
  for (auto it = fs::directory_iterator(root, ec); !ec && it != fs::directory_iterator(); it.increment(ec)) {
    const fs::path folder = it->path();
    std::error_code one;
    if (folder.filename().string().front() == '.') continue;
    if (!fs::is_directory(fs::symlink_status(folder, one)) || !fs::exists(folder / "case.toml", one))
      continue;
    all.push_back(summarize_case(folder, trust));
  }
  if (ec) return bad_input("cannot list cases", root.string(), ec.message());
  std::sort(all.begin(), all.end(), [](const CaseSummary& a, const CaseSummary& b) {
    return a.id != b.id ? a.id < b.id : a.folder < b.folder;
  });
  return all;
}

}  // namespace gnathion
