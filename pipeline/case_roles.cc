#include "pipeline/case_roles.h"

namespace gnathion {

const std::vector<CaseRole>& case_roles() {
  using C = CaseFile;
  using K = CaseFileKind;
  static const std::vector<CaseRole> roles = {
      {"scans", "maxilla_mi", &C::maxilla_mi, "scans", K::kMesh},
      {"scans", "mandible_mi", &C::mandible_mi, "scans", K::kMesh},
      {"scans", "maxilla_tp", &C::maxilla_tp, "scans", K::kMesh},
      {"scans", "mandible_tp", &C::mandible_tp, "scans", K::kMesh},
      {"scans", "mandible_clutch", &C::mandible_clutch, "scans", K::kMesh},
      {"scans", "face_mi", &C::face_mi, "scans", K::kMesh},
      {"scans", "face_tp", &C::face_tp, "scans", K::kMesh},
      {"scans", "occlusal_surface", &C::occlusal_surface, "scans", K::kMesh},
      {"scans", "cbct", &C::cbct, "scans", K::kVolume},
      {"bodies", "bow", &C::bow_model, "bodies", K::kMesh},
      {"bodies", "head_frame", &C::head_frame_model, "bodies", K::kMesh},
      {"session", "rig", &C::rig, "rig", K::kToml},
      {"session", "recording", &C::recording, "recordings", K::kRecording},
      {"session", "motion", &C::motion, "recordings", K::kMotion},
      {"calibrations", "chain", &C::chain, "calibrations", K::kJson},
      {"position", "transform", &C::transform, "calibrations", K::kTransform},
      {"truth", "poses", &C::truth, "truth", K::kJson}};
  return roles;
}

const CaseRole* find_case_role(std::string_view name) {
  for (const CaseRole& role : case_roles())
    if (name == role.name() || name == role.key) return &role;
  return nullptr;
}

}  // namespace gnathion
