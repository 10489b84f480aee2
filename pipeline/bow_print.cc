#include "pipeline/bow_print.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "pipeline/version.h"
#include "rendering/scene.h"
#include "rendering/tag_sheet.h"
#include "tracking/tag_family.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr Color kPrinted = {0.36, 0.61, 0.86};

TriangleMesh front_of(const TriangleMesh& mesh, double back_mm) {
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = mesh.corner(t, 0).y() < back_mm;
  return submesh(mesh, keep);
}

Status draw_bow(const BowPrintJob& job, const BowDesign& design, const fs::path& folder) {
  GNATHION_TRY(const TriangleMesh maxilla_scan, read_jaw(job.maxilla));
  GNATHION_TRY(const TriangleMesh mandible_scan, read_jaw(job.mandible));
  const Rigid3& bow_from_dental = design.bow_from_dental.rigid;
  const TriangleMesh maxilla = transformed(bow_from_dental, maxilla_scan),
                     mandible = transformed(bow_from_dental, mandible_scan);
  const TriangleMesh lower_front = front_of(mandible, 18), upper_front = front_of(maxilla, 18);
  const SceneMesh bow{&design.bow.surface, kPrinted, 1.0, {}}, clutch{&design.clutch, kPrinted, 1.0, {}};
  const SceneMesh teeth{&lower_front, palette::kMandibleIvory, 1.0, {}};
  const auto picture = [&](const char* name, const std::string& title, const std::vector<SceneMesh>& meshes,
                           const Vector3& eye) -> Status {
    PictureOptions options;
    options.title = title;
    return render_scene(folder / name, meshes, {}, {eye, Vector3::UnitZ(), 1.0}, options);
  };
  GNATHION_CHECK_OK(
      picture("bow_on_jaws.png", "Bow on the lower arch, jaws in MI",
              {bow, {&mandible, palette::kMandibleIvory, 1.0, {}}, {&maxilla, palette::kToothIvory, 1.0, {}}},
              {0.9, -1, 0.5}));
  GNATHION_CHECK_OK(picture("bow_front.png", "Bow from the front", {bow}, {0, -1, 0}));
  GNATHION_CHECK_OK(
      picture("clutch.png", "Clutch on the lower front teeth", {clutch, teeth}, {0.5, -0.8, 0.7}));
  GNATHION_CHECK_OK(picture("clutch_side.png", "Clutch and maxilla in MI, from the left",
                            {clutch, teeth, {&upper_front, palette::kToothIvory, 0.45, {}}}, {1, 0, 0}));
  return picture("head_frame.png", "Head frame", {{&design.head_frame.surface, kPrinted, 1.0, {}}},
                 {0.4, -1, 0.3});
}

std::vector<PlacedTag> seen_from_front(const TaggedBody& body) {
  std::vector<PlacedTag> out;
  for (const BodyTag& tag : body.tags) {
    PlacedTag placed{tag.id, {}};
    for (const Vector3& c : tag.corners_in_body_mm) placed.corners_mm.emplace_back(c.x(), c.z());
    out.push_back(placed);
  }
  return out;
}

}  // namespace

Result<BowDesign> run_bow_print(const BowPrintJob& job, const BowParameters& parameters, Progress& progress) {
  BowInputs inputs;
  GNATHION_TRY(inputs.maxilla, read_jaw(job.maxilla));
  GNATHION_TRY(inputs.mandible_mi, read_jaw(job.mandible));
  for (const fs::path& path : job.transforms) {
    GNATHION_TRY(const MotionFile motion, read_motion(path));
    inputs.jaw_positions.push_back(motion.motion);
  }
  return design_bow(inputs, parameters, progress);
}

Status write_tag_sheets(const fs::path& pdf, const std::vector<const TaggedBody*>& bodies, double side_mm) {
  std::vector<std::shared_ptr<const Drawing>> pages;
  std::vector<std::pair<std::string, std::vector<PlacedTag>>> places;
  for (const TaggedBody* body : bodies) {
    GNATHION_TRY(const TagFamily family, TagFamily::load(body->family));
    std::vector<SheetTag> tags;
    for (const BodyTag& tag : body->tags) {
      SheetTag sheet{tag.id, family.square_cells(), {}};
      for (int y = 0; y < sheet.square_cells; ++y)
        for (int x = 0; x < sheet.square_cells; ++x) sheet.white.push_back(family.white(tag.id, x, y));
      tags.push_back(std::move(sheet));
    }
    std::string name = body->name;
    std::replace(name.begin(), name.end(), '_', ' ');
    for (auto& page : tag_sheets(tags, side_mm, name)) pages.push_back(std::move(page));
    places.emplace_back(name, seen_from_front(*body));
  }
  pages.push_back(tag_placement_page(places));
  return write_pdf(pdf, pages, {"Tags of bow and head frame", std::string("gnathion ") + kVersion, ""});
}

Status write_bow_print(const BowPrintJob& job, const BowDesign& design, const BowParameters& parameters,
                       const fs::path& folder, Progress& progress) {
  progress.begin_step("writing", 0.1);
  const std::string suffix = design.verdict == "pass" ? ".stl" : ".rejected.stl";
  GNATHION_CHECK_OK(write_mesh(folder / ("bow" + suffix), design.bow.surface));
  GNATHION_CHECK_OK(write_mesh(folder / ("head_frame" + suffix), design.head_frame.surface));
  const std::string comment =
      fmt::format("As designed, black squares {:.2f} mm. Calibrate from a film: gnathion calibrate bow.",
                  parameters.tag_side_mm);
  GNATHION_CHECK_OK(write_body(folder / "bow.toml", design.bow.tags, comment));
  GNATHION_CHECK_OK(write_body(folder / "head_frame.toml", design.head_frame.tags, comment));
  GNATHION_CHECK_OK(write_tag_sheets(folder / "tags.pdf", {&design.bow.tags, &design.head_frame.tags},
                                     parameters.tag_side_mm));
  nlohmann::json j = bow_design_json(design, parameters);
  j["version"] = kVersion;
  for (const fs::path& input : {job.maxilla, job.mandible}) {
    GNATHION_TRY(const std::string sha256, sha256_of_file(input));
    j["inputs"].push_back({{"path", input.string()}, {"sha256", sha256}});
  }
  GNATHION_CHECK_OK(write_json(folder / "bow.json", j));
  std::error_code ec;
  fs::create_directories(folder / "pictures", ec);
  return draw_bow(job, design, folder / "pictures");
}

}  // namespace gnathion
