// landmarks.toml, and landmarks of two arches.
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>

#include "core/file.h"
#include "core/mesh_io.h"
#include "occlusion/arch.h"
#include "pipeline/motion_analysis.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot read landmarks";

Result<std::optional<Vector3>> point(const toml::table& t, const char* key, const std::string& where) {
  const auto node = t[key];
  if (!node) return std::optional<Vector3>();
  const auto* array = node.as_array();
  Vector3 p;
  bool good = array != nullptr && array->size() == 3;
  for (std::size_t i = 0; good && i < 3; ++i) {
    const auto v = (*array)[i].value<double>();
    good = v && std::isfinite(*v);
    if (good) p[static_cast<Eigen::Index>(i)] = *v;
  }
  if (!good) return bad_input(kWhat, where, fmt::format("'{}' is not three numbers", key));
  return std::optional<Vector3>(p);
}

Result<double> number(const toml::table& t, const char* key, double otherwise, const std::string& where) {
  if (!t[key]) return otherwise;
  const auto v = t[key].value<double>();
  if (!v || !std::isfinite(*v) || *v < 0)
    return bad_input(kWhat, where, fmt::format("'{}' is not a number from 0 on", key));
  return *v;
}

using Points = std::map<std::string, std::optional<Vector3>>;

Result<ReferencePlane> plane_of(const std::string& name, const Points& p, const std::string& where) {
  const auto through = [&](const char* left, const char* right, const char* front) -> Result<ReferencePlane> {
    for (const char* key : {left, right, front})
      if (!p.at(key)) return bad_input(kWhat, where, fmt::format("the {} plane needs '{}'", name, key));
    return plane_through(name, *p.at(left), *p.at(right), *p.at(front));
  };
  if (name == "occlusal") return through("molar_left_mm", "molar_right_mm", "incisal_mm");
  if (name == "frankfort") return through("porion_left_mm", "porion_right_mm", "orbitale_mm");
  if (name == "axis-orbital") return through("condyle_left_mm", "condyle_right_mm", "orbitale_mm");
  return bad_input(kWhat, where, "plane '" + name + "' is none of occlusal, frankfort, axis-orbital");
}

}  // namespace

Result<JawLandmarks> read_landmarks(const fs::path& path) {
  const std::string where = path.string();
  GNATHION_TRY(const toml::table t, read_toml(path, kWhat));
  Points points;
  for (const char* key : {"incisal_mm", "molar_left_mm", "molar_right_mm", "condyle_left_mm",
                          "condyle_right_mm", "porion_left_mm", "porion_right_mm", "orbitale_mm"}) {
    GNATHION_TRY(points[key], point(t, key, where));
  }
  const std::set<std::string> others = {"plane", "intercondylar_mm", "sigma_mm", "condyle_sigma_mm"};
  for (const auto& [key, value] : t) {
    const std::string name(key.str());
    if (!points.count(name) && !others.count(name))
      return bad_input(kWhat, where, "unknown key '" + name + "'");
  }
  for (const char* key : {"incisal_mm", "molar_left_mm", "molar_right_mm"})
    if (!points[key]) return bad_input(kWhat, where, fmt::format("'{}' is missing", key));
  JawLandmarks l;
  l.incisal_mm = *points["incisal_mm"];
  l.molar_left_mm = *points["molar_left_mm"];
  l.molar_right_mm = *points["molar_right_mm"];
  l.condyle_left_mm = points["condyle_left_mm"];
  l.condyle_right_mm = points["condyle_right_mm"];
  GNATHION_TRY(l.intercondylar_mm, number(t, "intercondylar_mm", l.intercondylar_mm, where));
  GNATHION_TRY(l.sigma_mm, number(t, "sigma_mm", 0, where));
  GNATHION_TRY(l.condyle_sigma_mm, number(t, "condyle_sigma_mm", 0, where));
  GNATHION_TRY(l.plane, plane_of(t["plane"].value_or<std::string>("occlusal"), points, where));
  return l;
}

Result<JawLandmarks> landmarks_of_arches(const fs::path& maxilla, const fs::path& mandible) {
  GNATHION_TRY(const TriangleMesh upper, read_jaw(maxilla));
  GNATHION_TRY(const TriangleMesh lower, read_jaw(mandible));
  GNATHION_TRY(const ArchFrame arch, find_arch(upper, lower));
  JawLandmarks l;
  l.incisal_mm = arch.incisal_mm;
  l.molar_left_mm = arch.curve_mm.back();
  l.molar_right_mm = arch.curve_mm.front();
  l.plane.left = arch.left;
  l.plane.anterior = arch.anterior;
  l.plane.up = arch.up;
  return l;
}

}  // namespace gnathion
