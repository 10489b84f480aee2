// Which files an import reads: for those who must send them to where it runs.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <set>

#include "core/file.h"
#include "pipeline/case_path.h"
#include "pipeline/dpvision_workspace.h"
#include "pipeline/import_case.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot import";

void collect_meshes(const std::vector<DpNode>& nodes, std::set<std::string>& names) {
  for (const DpNode& node : nodes) {
    if (node.kind == DpNode::Kind::kShell && !node.file.empty()) names.insert(node.file);
    collect_meshes(node.children, names);
  }
}

Result<std::set<std::string>> meshes_of_workspace(const fs::path& from) {
  GNATHION_TRY(const std::string text, read_file(from));
  GNATHION_TRY(const DpWorkspace workspace, parse_dpw(text, from.string()));
  std::set<std::string> names;
  collect_meshes(workspace.nodes, names);
  return names;
}

/// The data file that the header of a .mhd names; none: the data lie in it.
std::set<std::string> data_of_header(const fs::path& from) {
  std::ifstream in(from, std::ios::binary);
  std::set<std::string> names;
  std::string line;
  for (int i = 0; i < 10'000 && std::getline(in, line); ++i) {
    if (line.rfind("ElementDataFile", 0) != 0) continue;
    const std::size_t at = line.find_first_not_of(" =\t", 15), end = line.find_last_not_of(" \t\r");
    if (at != std::string::npos && line.substr(at, end + 1 - at) != "LOCAL")
      names.insert(line.substr(at, end + 1 - at));
    break;
  }
  return names;
}

/// `name`, as a file names it, below the folder that both lie in: "./a//b.stl" is "a/b.stl".
Result<ImportSource> source_beside(const CaseRoot& folder, const std::string& name, const fs::path& from) {
  const std::string beside = "; it must lie beside " + from.filename().string();
  if (fs::path(name).is_absolute())
    return bad_input(kWhat, name,
                     "is an absolute path, which is lost where it is sent to: name it as seen from " +
                         from.filename().string());
  const auto path = folder.resolve(name);
  if (!path) return bad_input(kWhat, name, path.error().why + beside);
  std::error_code ec;
  if (!fs::is_regular_file(*path, ec)) return bad_input(kWhat, name, "is not a file");
  const fs::path below = path->lexically_relative(folder.path());
  for (const fs::path& part : below)
    if (part.string().front() == '.') return bad_input(kWhat, name, "is hidden: rename it to send it");
  if (std::distance(below.begin(), below.end()) > kDeepestImportSource)
    return bad_input(kWhat, name,
                     fmt::format("lies more than {} folders deep: move it up", kDeepestImportSource - 1));
  return ImportSource{below.generic_string(), *path};
}

std::string extension_of(const fs::path& path) {
  std::string ext = path.extension().string();
  for (char& c : ext) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return ext;
}

Result<std::vector<ImportSource>> plain_files_of(const fs::path& folder) {
  std::vector<ImportSource> all;
  std::error_code ec;
  for (auto it = fs::directory_iterator(folder, ec); !ec && it != fs::directory_iterator();
       it.increment(ec)) {
    const std::string name = it->path().filename().string();
    std::error_code one;
    if (name.front() != '.' && fs::is_regular_file(it->symlink_status(one)))
      all.push_back({name, it->path()});
  }
  if (ec) return bad_input(kWhat, folder.string(), ec.message());
  if (all.empty()) return bad_input(kWhat, folder.string(), "holds no file");
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  return all;
}

}  // namespace

Result<std::vector<ImportSource>> import_sources(const fs::path& from) {
  std::error_code ec;
  if (!fs::exists(from, ec)) return bad_input(kWhat, from.string(), "does not exist");
  if (fs::is_directory(from, ec)) return plain_files_of(from);
  const std::string ext = extension_of(from);
  std::set<std::string> others;
  if (ext == ".dpw" || ext == ".atmdl") {
    GNATHION_TRY(others, meshes_of_workspace(from));
  } else if (ext == ".mhd") {
    others = data_of_header(from);
  }
  std::vector<ImportSource> all = {{from.filename().string(), from}};
  GNATHION_TRY(const CaseRoot beside, CaseRoot::open(from.has_parent_path() ? from.parent_path() : "."));
  for (const std::string& name : others) {
    GNATHION_TRY(const ImportSource source, source_beside(beside, name, from));
    const auto same = [&](const ImportSource& s) { return s.name == source.name; };
    if (std::none_of(all.begin(), all.end(), same)) all.push_back(source);
  }
  return all;
}

}  // namespace gnathion
