#include "pipeline/planned_splint.h"

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

/// A file that a design was made from, as design.json records it.
struct Recorded {
  fs::path path;
  std::string sha256;
};

Result<std::vector<Recorded>> recorded_inputs(const fs::path& folder) {
  GNATHION_TRY(const json design, read_json(folder / "design.json"));
  std::vector<Recorded> out;
  if (design.is_object() && design.contains("arch") && design["arch"] == "mandible")
    return bad_input("cannot evaluate", (folder / "design.json").string(),
                     "a mandibular splint: the procedures are those of maxillary ones");
  if (!design.is_object() || !design.contains("inputs") || !design["inputs"].is_array())
    return bad_input("cannot read design", (folder / "design.json").string(), "no inputs are recorded");
  for (const json& i : design["inputs"]) {
    if (!i.is_object() || !i.contains("path") || !i["path"].is_string())
      return bad_input("cannot read design", (folder / "design.json").string(), "an input has no path");
    out.push_back({i["path"].get<std::string>(), i.value("sha256", "")});
  }
  if (out.size() < 3)
    return bad_input("cannot read design", (folder / "design.json").string(),
                     "maxilla, mandible and transform should be recorded");
  return out;
}

/// Where a recorded path lies now: as it was given, or beside the design.
fs::path found(const fs::path& path, const fs::path& folder) {
  std::error_code ec;
  for (const fs::path& candidate :
       {path, folder / path, folder.parent_path() / path, folder / path.filename()})
    if (fs::exists(candidate, ec)) return candidate;
  return path;
}

/// The file that plays a role: `given`, or the recorded one, which must be unchanged.
Result<EvaluationInput> chosen(const fs::path& given, const Recorded& recorded, const fs::path& folder,
                               std::vector<std::string>& warnings) {
  const fs::path path = given.empty() ? found(recorded.path, folder) : given;
  GNATHION_TRY(const std::string hash, sha256_of_file(path));
  if (!recorded.sha256.empty() && hash != recorded.sha256) {
    if (given.empty())
      return bad_input(
          "cannot use design", path.string(),
          "its content has changed since the splint was designed (SHA-256 differs from design.json)");
    warnings.push_back(path.string() +
                       " is not the file that the splint was designed from (SHA-256 differs)");
  }
  return EvaluationInput{path.string(), hash};
}

SharedMesh shared(TriangleMesh mesh) {
  return std::make_shared<const TriangleMesh>(std::move(mesh));
}

}  // namespace

Result<PlannedFiles> read_planned_splint(const EvaluateSplint& files) {
  std::error_code ec;
  fs::path folder = files.design;
  if (!folder.has_filename()) folder = folder.parent_path();  // "designs/a/" is "designs/a"
  GNATHION_TRY(const std::vector<Recorded> recorded, recorded_inputs(folder));
  if (!fs::exists(folder / "splint.stl", ec))
    return bad_input("cannot use design", folder.string(),
                     fs::exists(folder / "splint.rejected.stl", ec)
                         ? "its splint was rejected: see design.json"
                         : "it holds no splint.stl");
  PlannedFiles out;
  GNATHION_TRY(const std::string hash, sha256_of_file(folder / "splint.stl"));
  out.inputs.push_back({(folder / "splint.stl").string(), hash});
  const fs::path* const given[] = {&files.maxilla, &files.mandible, &files.transform};
  for (std::size_t i = 0; i < 3; ++i) {
    GNATHION_TRY(EvaluationInput input, chosen(*given[i], recorded[i], folder, out.warnings));
    out.inputs.push_back(std::move(input));
  }

  PlannedSplint& p = out.planned;
  p.name = fs::absolute(folder, ec).filename().string();
  GNATHION_TRY(TriangleMesh splint, read_mesh(folder / "splint.stl"));
  GNATHION_TRY(TriangleMesh maxilla, read_jaw(out.inputs[1].path));
  GNATHION_TRY(TriangleMesh mandible, read_jaw(out.inputs[2].path));
  GNATHION_TRY(const MotionFile motion, read_motion(out.inputs[3].path));
  p.therapeutic = motion.motion;
  if (files.mandible_is_in_tp) mandible = transformed(p.therapeutic.rigid.inverse(), mandible);
  p.splint = shared(std::move(splint));
  p.maxilla = shared(std::move(maxilla));
  p.mandible_mi = shared(std::move(mandible));
  return out;
}

}  // namespace gnathion
