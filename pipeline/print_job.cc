#include "pipeline/print_job.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/transform_io.h"
#include "design/printing/build_direction.h"
#include "design/printing/plate.h"
#include "design/verification.h"
#include "design/write_3mf.h"
#include "design/write_ply.h"
#include "pipeline/version.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr char kWhat[] = "cannot prepare print";
constexpr double kUndoneMm = 0.001;        // file coordinates against the design, the compensation undone
constexpr double kCavitySupportMm2 = 2.0;  // rounding of the rim
constexpr double kGapMm = 0.005;           // difference that no printer tells apart

struct Part {
  std::string name, design_sha256, ply_sha256;
  json design;
  SplintSurface splint;
  BuildDirection direction;
  PlatePlacement placement;
  std::vector<Gate> gates;
};

Result<Part> read_part(const fs::path& folder) {
  Part part;
  part.name = fs::path(folder / "").parent_path().filename().string();
  GNATHION_TRY(part.design, read_json(folder / "design.json"));
  const std::string verdict = part.design.is_object() ? part.design.value("verdict", "") : "";
  if (verdict != "pass")
    return fail(ErrorCode::kGate, kWhat, folder.string(),
                "its design did not pass: " + (verdict.empty() ? "no verdict" : verdict));
  GNATHION_TRY(part.splint, read_splint_ply(folder / "splint.ply"));
  GNATHION_TRY(const TriangleMesh stl, read_mesh(folder / "splint.stl"));
  if (stl.triangles.size() != part.splint.mesh.triangles.size())
    return bad_input(kWhat, folder.string(), "splint.ply and splint.stl are of two designs");
  GNATHION_TRY(part.design_sha256, sha256_of_file(folder / "design.json"));
  GNATHION_TRY(part.ply_sha256, sha256_of_file(folder / "splint.ply"));
  return part;
}

Result<Vector3> seating_direction(const Part& part) {
  const json& insertion = part.design.value("insertion", json::object());
  const json& d = insertion.value("direction", json::array());
  if (!d.is_array() || d.size() != 3 || !d[0].is_number() || !d[1].is_number() || !d[2].is_number())
    return bad_input(kWhat, part.name + "/design.json", "no insertion.direction");
  const Vector3 a(d[0], d[1], d[2]);
  if (!(a.norm() > 0.5)) return bad_input(kWhat, part.name + "/design.json", "no insertion.direction");
  return Vector3(a.normalized());
}

double design_gap_mm(const Part& part) {
  return part.design.value("parameters", json::object()).value("gap_mm", -1.0);
}

Gate at_most(const char* name, double value, double limit, bool blocks) {
  return {name, value, limit, value <= limit, blocks};
}

/// What holds of the mesh as it goes to the printer, coordinates as an STL holds them.
std::vector<Gate> gates_of(const Part& part, const TriangleMesh& as_written, const PrinterProfile& profile,
                           const PrintMaterial* material) {
  const MeshTopology t = mesh_topology(as_written);
  double undone = 0.0;  // the printer's scale about the plate's origin shifts the part, and no more
  const Matrix3 printed = profile.printed_scale.asDiagonal();
  const Matrix3 turn = printed * part.placement.linear;  // a rotation, if the compensation is right
  for (std::size_t v = 0; v < as_written.vertices_mm.size(); ++v) {
    const Vector3 from_file = printed * (as_written.vertices_mm[v] - part.placement.translation_mm);
    undone = std::max(undone, (turn.transpose() * from_file - part.splint.mesh.vertices_mm[v]).norm());
  }
  const auto count = [](std::size_t n) { return static_cast<double>(n); };
  std::vector<Gate> gates = {
      at_most("open_edges", count(t.boundary_edges), 0, true),
      at_most("non_manifold", count(t.non_manifold_edges + t.non_manifold_vertices), 0, true),
      at_most("self_intersections", count(self_intersections(as_written).size()), 0, true),
      at_most("compensation_undone_mm", undone, kUndoneMm, true),
      at_most("cavity_support_mm2",
              part.direction.cavity_overhang_mm2 + part.direction.standing_in_cavity_mm2, kCavitySupportMm2,
              false)};
  if (material)
    gates.push_back(
        at_most("gap_off_material_mm", std::abs(design_gap_mm(part) - material->gap_mm), kGapMm, false));
  return gates;
}

/// Rounded to the floats that an STL holds.
TriangleMesh as_floats(TriangleMesh mesh) {
  for (Vector3& v : mesh.vertices_mm) v = v.cast<float>().cast<double>();
  return mesh;
}

json gates_json(const std::vector<Gate>& gates) {
  json out = json::array();
  for (const Gate& g : gates)
    out.push_back(
        {{"name", g.name}, {"value", g.value}, {"limit", g.limit}, {"pass", g.pass}, {"blocks", g.blocks}});
  return out;
}

json part_json(const Part& part) {
  Matrix4 m = Matrix4::Identity();
  m.topLeftCorner<3, 3>() = part.placement.linear;
  m.topRightCorner<3, 1>() = part.placement.translation_mm;
  const BuildDirection& d = part.direction;
  return {{"name", part.name},
          {"plate", part.placement.plate + 1},
          {"design_sha256", part.design_sha256},
          {"splint_ply_sha256", part.ply_sha256},
          {"plate_from_dental", matrix_json(m)},
          {"build",
           {{"up", {d.up.x(), d.up.y(), d.up.z()}},
            {"height_mm", d.height_mm},
            {"overhang_mm2", d.overhang_mm2},
            {"cavity_overhang_mm2", d.cavity_overhang_mm2},
            {"standing_in_cavity_mm2", d.standing_in_cavity_mm2}}},
          {"gates", gates_json(part.gates)},
          {"design_gates", part.design.value("gates", json::array())}};
}

json profile_json(const PrinterProfile& p, const PrintMaterial* material) {
  json out = {{"name", p.name},
              {"source", p.source},
              {"printed_scale", {p.printed_scale.x(), p.printed_scale.y(), p.printed_scale.z()}},
              {"scale_source", p.scale_source},
              {"self_supporting_deg", p.self_supporting_deg},
              {"material", nullptr}};
  if (material)
    out["material"] = {{"name", material->name}, {"gap_mm", material->gap_mm}, {"source", material->source}};
  return out;
}

Status write_plate(const std::vector<Part>& parts, std::size_t plate, const std::string& profile,
                   const fs::path& folder) {
  // Turned and scaled coordinates with a shift as the item's transform: slicers that hold a rotation and a
  // scale apart cannot take both in one matrix.
  std::vector<TriangleMesh> turned;
  turned.reserve(parts.size());
  std::vector<PlatePart> items;
  TriangleMesh all;
  std::vector<std::pair<std::string, std::string>> metadata = {{"printer", profile}};
  for (const Part& part : parts) {
    if (part.placement.plate != plate) continue;
    turned.push_back(placed({part.placement.linear, Vector3::Zero(), plate}, part.splint.mesh));
    items.push_back({part.name, &turned.back(), Matrix3::Identity(), part.placement.translation_mm});
    all = merged(all, placed(part.placement, part.splint.mesh));
    metadata.emplace_back(fmt::format("part_{}", items.size()),
                          part.name + " design.json sha256:" + part.design_sha256);
  }
  const std::string name = fmt::format("plate_{}", plate + 1);
  GNATHION_CHECK_OK(write_mesh(folder / (name + ".stl"), all));
  return write_3mf_plate(folder / (name + ".3mf"), items, metadata);
}

/// Names told apart: "splint", "splint_2".
void number_equal_names(std::vector<Part>& parts) {
  std::map<std::string, std::size_t> times;
  for (Part& part : parts) {
    const std::size_t n = ++times[part.name];
    if (n > 1) part.name += fmt::format("_{}", n);
  }
}

}  // namespace

Result<PrintOutcome> prepare_print(const PrintJob& job, const fs::path& folder, Progress& progress) {
  progress.begin_step("reading", 0.2);
  GNATHION_TRY(const PrinterProfile profile, read_printer_profile(job.profile));
  const PrintMaterial* material = job.material.empty() ? nullptr : profile.material(job.material);
  if (!job.material.empty() && !material)
    return fail(ErrorCode::kUsage, kWhat, job.profile.string(), "no material \"" + job.material + "\"");
  std::vector<Part> parts;
  for (const fs::path& design : job.designs) {
    GNATHION_TRY(Part part, read_part(design));
    parts.push_back(std::move(part));
  }
  if (parts.empty()) return fail(ErrorCode::kUsage, kWhat, "--design", "none is given");
  number_equal_names(parts);

  progress.begin_step("turning and laying out", 0.3);
  std::vector<const TriangleMesh*> meshes;
  std::vector<Vector3> up;
  std::vector<std::string> names;
  for (Part& part : parts) {
    GNATHION_TRY(const Vector3 a, seating_direction(part));
    part.direction = find_build_direction(part.splint, a, profile.self_supporting_deg);
    meshes.push_back(&part.splint.mesh);
    up.push_back(part.direction.up);
    names.push_back(part.name);
  }
  GNATHION_TRY(const std::vector<PlatePlacement> placements, laid_out(meshes, up, names, profile));

  progress.begin_step("judging", 0.3);
  PrintOutcome outcome;
  outcome.passed = true;
  json part_facts = json::array(), violated = json::array();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    Part& part = parts[i];
    part.placement = placements[i];
    part.gates = gates_of(part, as_floats(placed(part.placement, part.splint.mesh)), profile, material);
    for (const Gate& gate : part.gates) {
      if (gate.pass) continue;
      if (gate.blocks) violated.push_back(part.name + ": " + gate.name);
      outcome.passed = outcome.passed && !gate.blocks;
      if (gate.name == "gap_off_material_mm")
        outcome.warnings.push_back(
            fmt::format("{} was designed with a gap of {} mm, {} wants {}: design it again with --set "
                        "design.gap_mm={}",
                        part.name, design_gap_mm(part), material->name, material->gap_mm, material->gap_mm));
      if (gate.name == "cavity_support_mm2")
        outcome.warnings.push_back(fmt::format(
            "{}: {:.1f} mm² of the cavity need supports in the best direction", part.name, gate.value));
    }
    outcome.plates = std::max(outcome.plates, part.placement.plate + 1);
    part_facts.push_back(part_json(part));
  }
  outcome.parts = parts.size();

  progress.begin_step("writing", 0.2);
  if (outcome.passed)
    for (std::size_t plate = 0; plate < outcome.plates; ++plate)
      GNATHION_CHECK_OK(write_plate(parts, plate, profile.name, folder));
  outcome.report = std::make_shared<json>(json{{"verdict", outcome.passed ? "pass" : "fail"},
                                               {"violated", violated},
                                               {"version", kVersion},
                                               {"profile", profile_json(profile, material)},
                                               {"plates", outcome.plates},
                                               {"parts", part_facts},
                                               {"warnings", outcome.warnings}});
  GNATHION_CHECK_OK(write_json(folder / "print.json", *outcome.report));
  return outcome;
}

}  // namespace gnathion
