#include "viewer/case_scene.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "pipeline/case_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

struct Look {
  const char* name;
  Color color_3d, color_2d;
  double width_2d_px, opacity;
  bool visible;
};

constexpr Look kMaxilla = {"Maxilla", palette::kToothIvory, palette::kMaxilla, 1.5, 1.0, true};
constexpr Look kMandibleMi = {"Mandible in MI", palette::kMandibleIvory, {0.55, 0.75, 0.55}, 1.0, 1.0, false};
constexpr Look kMandibleTp = {"Mandible in TP", palette::kMandibleIvory, palette::kMandible, 1.5, 1.0, true};
constexpr Look kSplint = {"Splint", palette::kSplintClear, palette::kSplint, 2.5, 0.75, true};

void add_layer(CaseScene& scene, const Look& look, TriangleMesh mesh) {
  scene.layers.push_back({look.name, std::move(mesh), look.color_3d, look.color_2d, look.width_2d_px,
                          look.opacity, look.visible});
}

/// Nothing, with a line in `missing`, when the file cannot be read.
std::optional<TriangleMesh> try_mesh(CaseScene& scene, const Look& look, const fs::path& path) {
  std::error_code ec;
  if (!fs::exists(path, ec)) {
    scene.missing.push_back(fmt::format("{}: {} does not exist", look.name, path.filename().string()));
    return std::nullopt;
  }
  Result<TriangleMesh> mesh = read_mesh(path);
  if (!mesh) {
    scene.missing.push_back(fmt::format("{}: {}", look.name, mesh.error().line()));
    return std::nullopt;
  }
  return std::move(*mesh);
}

void read_gates(CaseScene& scene, const fs::path& design_json) {
  std::error_code ec;
  if (!fs::exists(design_json, ec)) {
    scene.missing.push_back("Gates: design.json does not exist; 'gnathion run' makes it");
    return;
  }
  const Result<nlohmann::json> report = read_json(design_json);
  if (!report || !report->is_object()) {
    scene.missing.push_back("Gates: design.json cannot be read");
    return;
  }
  scene.verdict = report->value("verdict", std::string());
  for (const auto& g : report->value("gates", nlohmann::json::array())) {
    if (!g.is_object() || !g.contains("value") || !g["value"].is_number() || !g["limit"].is_number())
      continue;
    scene.gates.push_back({g.value("name", std::string("?")), g["value"].get<double>(),
                           g["limit"].get<double>(), g.value("pass", false)});
  }
}

}  // namespace

Result<CaseScene> open_case(const fs::path& folder) {
  GNATHION_TRY(const CaseFile files, read_case(folder));
  CaseScene scene;
  scene.title = fs::weakly_canonical(folder).filename().string();
  const fs::path results = folder / "results";

  const auto maxilla = try_mesh(scene, kMaxilla, files.maxilla_mi);
  const auto mandible = try_mesh(scene, kMandibleMi, files.mandible_mi);
  if (maxilla && mandible)
    if (Result<ArchFrame> arch = find_arch(*maxilla, *mandible)) scene.arch = std::move(*arch);
  if (maxilla) add_layer(scene, kMaxilla, *maxilla);
  if (mandible) {
    add_layer(scene, kMandibleMi, *mandible);
    if (const auto motion = read_motion(results / "T_th.json"))
      add_layer(scene, kMandibleTp, transformed(motion->motion.rigid, *mandible));
    else
      scene.missing.push_back("Mandible in TP: " + motion.error().line());
  }
  std::error_code ec;
  const fs::path rejected = results / "splint.rejected.stl";
  if (auto splint = try_mesh(scene, kSplint, fs::exists(rejected, ec) ? rejected : results / "splint.stl"))
    add_layer(scene, kSplint, std::move(*splint));
  read_gates(scene, results / "design.json");
  return scene;
}

}  // namespace gnathion
