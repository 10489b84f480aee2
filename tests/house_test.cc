// The house rules that a machine can check: who may include whom (docs/architecture.md), third-party
// headers kept out of ours, nothing that names a machine's paths.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
using Modules = std::set<std::string>;

const fs::path kRoot = GNATHION_SOURCE_DIR;

const std::map<std::string, Modules>& allowed() {
  static const Modules verbs = {"core", "registration", "occlusion"};
  static const Modules siblings = {"core",        "registration", "occlusion",   "rendering",
                                   "acquisition", "tracking",     "calibration", "anatomy",
                                   "design",      "evaluation",   "phantom"};
  static const std::map<std::string, Modules> rules = [] {
    std::map<std::string, Modules> r;
    r["core"] = {};
    r["registration"] = r["occlusion"] = r["rendering"] = {"core"};
    for (const char* m : {"acquisition", "tracking", "calibration", "anatomy", "design", "evaluation"})
      r[m] = verbs;
    r["phantom"] = {"core"};
    r["pipeline"] = siblings;
    Modules faces = siblings;
    faces.insert("pipeline");
    faces.insert("client");
    r["client"] = {"core"};
    r["cli"] = r["daemon"] = r["viewer"] = faces;
    return r;
  }();
  return rules;
}

std::vector<fs::path> sources_of(const fs::path& folder) {
  std::vector<fs::path> files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.path().extension() == ".h" || entry.path().extension() == ".cc") files.push_back(entry.path());
  return files;
}

std::vector<std::string> includes_of(const fs::path& file) {
  static const std::regex include(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  std::vector<std::string> found;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    std::smatch m;
    if (std::regex_search(line, m, include)) found.push_back(m[1]);
  }
  return found;
}

TEST(House, ModulesIncludeOnlyWhatIsBelowThem) {
  int checked = 0;
  for (const auto& [module, below] : allowed()) {
    for (const fs::path& file : sources_of(kRoot / module))
      for (const std::string& include : includes_of(file)) {
        const std::string first = include.substr(0, include.find('/'));
        if (!allowed().count(first) || first == module) continue;
        ++checked;
        EXPECT_TRUE(below.count(first))
            << file << " includes " << include << ": " << module << " may not know " << first;
      }
  }
  EXPECT_GT(checked, 50);
}

/// Modules whose files include `header` ("rendering/window.h").
Modules includers_of(const std::string& header) {
  Modules modules;
  for (const auto& [module, below] : allowed())
    for (const fs::path& file : sources_of(kRoot / module))
      for (const std::string& include : includes_of(file))
        if (include == header) modules.insert(module);
  return modules;
}

/// A header that drags in a heavy library may exist only inside the one module that owns it (the viewer
/// draws with VTK as rendering does; all that stands above pipeline reads TOML through its one reader).
TEST(House, HeavyThirdPartyHeadersStayInsideTheirModule) {
  const std::regex heavy(
      R"(^(vtk|ceres/|openvdb/|opencv2/|embree3/|apriltag|Q[A-Z]|CGAL/|lib3mf|spdlog/|toml\+\+|CLI/|nlohmann/json\.hpp))");
  for (const auto& [module, below] : allowed())
    for (const fs::path& file : sources_of(kRoot / module)) {
      if (file.extension() != ".h") continue;
      for (const std::string& include : includes_of(file)) {
        if (!std::regex_search(include, heavy)) continue;
        const std::string header = fs::relative(file, kRoot).string();
        for (const std::string& user : includers_of(header))
          EXPECT_TRUE(user == module || (module == "rendering" && user == "viewer") ||
                      header == "pipeline/toml_file.h")
              << header << " drags " << include << " into " << user;
      }
    }
}

TEST(House, IncludePathsStartAtTheRoot) {
  for (const auto& [module, below] : allowed())
    for (const fs::path& file : sources_of(kRoot / module))
      for (const std::string& include : includes_of(file))
        EXPECT_EQ(include.find("../"), std::string::npos) << file << ": " << include;
}

TEST(House, NothingNamesAMachinesPath) {
  const std::regex path(R"((/work/|/home/|/root/|/tmp/b-))");
  for (const auto& [module, below] : allowed())
    for (const fs::path& file : sources_of(kRoot / module)) {
      std::ifstream in(file);
      std::stringstream text;
      text << in.rdbuf();
      EXPECT_FALSE(std::regex_search(text.str(), path)) << file;
    }
}

}  // namespace
