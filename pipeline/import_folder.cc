// A folder of scans, their roles guessed from their names.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <set>

#include "core/mesh_io.h"
#include "occlusion/arch.h"
#include "pipeline/case_roles.h"
#include "pipeline/import_draft.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot import";

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

bool holds(const std::string& text, std::initializer_list<const char*> words) {
  return std::any_of(words.begin(), words.end(),
                     [&](const char* w) { return text.find(w) != std::string::npos; });
}

/// Short words only where they stand alone.
bool holds_alone(const std::string& text, std::initializer_list<const char*> words) {
  std::string word;
  for (const char c : text + "_") {
    if (std::isalnum(static_cast<unsigned char>(c))) {
      word += c;
      continue;
    }
    if (std::find(words.begin(), words.end(), word) != words.end()) return true;
    word.clear();
  }
  return false;
}

/// "" where the name tells nothing, or two things at once.
std::string role_by_name(const fs::path& path) {
  const std::string name = lower(path.stem().string());
  const bool tp = holds_alone(name, {"tp", "cr"}) || holds(name, {"therap"});
  if (holds(name, {"occlus", "okluz"})) return "scans.occlusal_surface";
  if (holds(name, {"clutch"})) return "scans.mandible_clutch";
  if (holds(name, {"face", "twarz", "gesicht"})) return tp ? "scans.face_tp" : "scans.face_mi";
  if (holds(name, {"head_frame", "headframe"})) return "bodies.head_frame";
  if (holds_alone(name, {"bow"})) return "bodies.bow";
  const bool up = holds(name, {"upper", "maxil", "oberkiefer", "szczeka"}) || holds_alone(name, {"u", "ok"});
  const bool low =
      holds(name, {"lower", "mandib", "unterkiefer", "zuchwa"}) || holds_alone(name, {"l", "uk"});
  if (up == low) return "";
  return up ? (tp ? "scans.maxilla_tp" : "scans.maxilla_mi")
            : (tp ? "scans.mandible_tp" : "scans.mandible_mi");
}

bool is_mesh(const fs::path& path) {
  const std::string ext = lower(path.extension().string());
  return ext == ".stl" || ext == ".ply" || ext == ".obj";
}

/// Two meshes without a telling name: jaws, if their shapes say in one order only that they are.
Status by_shape(ImportDraft& draft, std::vector<fs::path>& unknown) {
  if (unknown.size() != 2 || !draft.file_of("scans.maxilla_mi").empty() ||
      !draft.file_of("scans.mandible_mi").empty())
    return {};
  GNATHION_TRY(const TriangleMesh a, read_jaw(unknown[0]));
  GNATHION_TRY(const TriangleMesh b, read_jaw(unknown[1]));
  const bool a_up = find_arch(a, b).has_value(), b_up = find_arch(b, a).has_value();
  if (a_up == b_up) return {};
  GNATHION_CHECK_OK(draft.take("scans.maxilla_mi", unknown[a_up ? 0 : 1], "by its shape alone"));
  GNATHION_CHECK_OK(draft.take("scans.mandible_mi", unknown[a_up ? 1 : 0], "by its shape alone"));
  unknown.clear();
  return {};
}

}  // namespace

Status import_folder(const CaseImport& what, ImportDraft& draft) {
  std::error_code ec;
  std::vector<fs::path> files;
  for (auto it = fs::directory_iterator(what.from, ec); !ec && it != fs::directory_iterator();
       it.increment(ec))
    if (it->path().filename().string().front() != '.' && fs::is_regular_file(it->symlink_status(ec)))
      files.push_back(it->path());
  if (ec) return bad_input(kWhat, what.from.string(), ec.message());
  std::sort(files.begin(), files.end());

  std::set<fs::path> used;
  for (const auto& [role, name] : what.roles) {
    const CaseRole* known = find_case_role(role);
    if (known == nullptr) return fail(ErrorCode::kUsage, kWhat, role, "is no role");
    // One of those that were listed: neither a link nor a path leads out of the folder.
    const fs::path path = what.from / fs::path(name).filename();
    const bool its_own = fs::path(name) == path || fs::path(name) == path.filename();
    if (!its_own || std::find(files.begin(), files.end(), path) == files.end())
      return bad_input(kWhat, name, "is no file of the folder; links are not followed");
    GNATHION_CHECK_OK(draft.take(known->name(), path, "as given"));
    used.insert(path);
  }
  std::vector<fs::path> unknown;
  for (const fs::path& file : files) {
    if (used.count(file) != 0) continue;
    const std::string name = lower(file.filename().string());
    std::string role = is_mesh(file) ? role_by_name(file) : "";
    if (file.extension() == ".mcap") role = "session.recording";
    if (name == "rig.toml") role = "session.rig";
    if (name == "t_th.json" || file.extension() == ".tfm") role = "position.transform";
    if (name == "bow.toml" || name == "head_frame.toml") continue;  // come with rig.toml
    if (!role.empty() && what.roles.count(find_case_role(role)->key) == 0)
      GNATHION_CHECK_OK(draft.take(role, file, "by its name"));
    else if (is_mesh(file) && role.empty())
      unknown.push_back(file);
    else
      draft.report.notes.push_back(file.filename().string() + " is left out");
  }
  GNATHION_CHECK_OK(by_shape(draft, unknown));
  for (const fs::path& file : unknown)
    draft.report.notes.push_back(file.filename().string() +
                                 ": its name tells no role; left out, --role takes it in");
  return confirm_jaws(what, draft);
}

}  // namespace gnathion
