#include "occlusion/clinical.h"

#include <algorithm>

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

constexpr double kEdgeMm = 0.4;  // of the crown's height that counts as its incisal edge

/// Mean of the vertices next to the crown's occlusal end; nothing where the tooth is missing.
std::optional<Vector3> edge_of(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi,
                               std::uint8_t tooth, const Vector3& gingival) {
  double lowest = 1e300;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v] == tooth) lowest = std::min(lowest, gingival.dot(mesh.vertices_mm[v]));
  Box edge;  // its middle does not depend on how densely each end is meshed
  bool any = false;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v] == tooth && gingival.dot(mesh.vertices_mm[v]) < lowest + kEdgeMm) {
      edge.extend(mesh.vertices_mm[v]);
      any = true;
    }
  if (!any) return std::nullopt;
  return edge.centre_mm();
}

std::optional<Vector3> midway(const std::optional<Vector3>& a, const std::optional<Vector3>& b) {
  if (a && b) return Vector3(0.5 * (*a + *b));
  return a ? a : b;
}

std::optional<Vector3> centroid_of(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi,
                                   std::uint8_t quadrant) {
  for (const int position : {6, 7, 5, 4}) {
    const int tooth = quadrant * 10 + position;
    Vector3 sum = Vector3::Zero();
    double count = 0.0;
    for (std::size_t v = 0; v < fdi.size(); ++v)
      if (fdi[v] == tooth) {
        sum += mesh.vertices_mm[v];
        count += 1.0;
      }
    if (count > 0.0) return Vector3(sum / count);
  }
  return std::nullopt;
}

}  // namespace

std::optional<BitePoints> bite_points(const TriangleMesh& maxilla,
                                      const std::vector<std::uint8_t>& maxilla_fdi,
                                      const TriangleMesh& mandible,
                                      const std::vector<std::uint8_t>& mandible_fdi, const ArchFrame& arch) {
  const Vector3 up = arch.up, down = -arch.up;
  const auto upper = midway(edge_of(maxilla, maxilla_fdi, 11, up), edge_of(maxilla, maxilla_fdi, 21, up));
  const auto lower =
      midway(edge_of(mandible, mandible_fdi, 31, down), edge_of(mandible, mandible_fdi, 41, down));
  if (!upper || !lower) return std::nullopt;
  return BitePoints{*upper, *lower, centroid_of(mandible, mandible_fdi, 3),
                    centroid_of(mandible, mandible_fdi, 4)};
}

BiteReadout bite_readout(const BitePoints& points, const ArchFrame& arch, const Rigid3& therapeutic) {
  const auto dropped = [&](const Vector3& p) { return -arch.up.dot(therapeutic * p - p); };
  const Vector3 lower = therapeutic * points.lower_incisal_mm;
  BiteReadout out;
  out.vertical_mm = dropped(points.lower_incisal_mm);
  if (points.left_molar_mm) out.vertical_left_mm = dropped(*points.left_molar_mm);
  if (points.right_molar_mm) out.vertical_right_mm = dropped(*points.right_molar_mm);
  out.overjet_mi_mm = arch.anterior.dot(points.upper_incisal_mm - points.lower_incisal_mm);
  out.overjet_mm = arch.anterior.dot(points.upper_incisal_mm - lower);
  out.overbite_mi_mm = arch.up.dot(points.lower_incisal_mm - points.upper_incisal_mm);
  out.overbite_mm = arch.up.dot(lower - points.upper_incisal_mm);
  out.midline_mm = arch.left.dot(lower - points.lower_incisal_mm);
  return out;
}

nlohmann::json bite_json(const std::optional<BiteReadout>& readout) {
  if (!readout) return nullptr;
  const auto value = [](const std::optional<double>& v) {
    return v ? nlohmann::json(*v) : nlohmann::json(nullptr);
  };
  return {{"vertical_change_mm", readout->vertical_mm},
          {"vertical_change_left_mm", value(readout->vertical_left_mm)},
          {"vertical_change_right_mm", value(readout->vertical_right_mm)},
          {"overjet_mi_mm", readout->overjet_mi_mm},
          {"overjet_mm", readout->overjet_mm},
          {"overbite_mi_mm", readout->overbite_mi_mm},
          {"overbite_mm", readout->overbite_mm},
          {"midline_shift_left_mm", readout->midline_mm}};
}

}  // namespace gnathion
