// 3MF files (core specification 1.x). Written here, because lib3mf is not known to give the same bytes twice
// (its writer was not tried); the tests read them back through lib3mf.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

/// A part of a plate: p_plate = linear * p + translation_mm, which the file holds as the item's transform.
struct PlatePart {
  std::string name;
  const TriangleMesh* mesh = nullptr;
  Matrix3 linear = Matrix3::Identity();
  Vector3 translation_mm = Vector3::Zero();
};
/// Several meshes, each as it is, with where it lies on the plate. Otherwise as write_3mf below.
Status write_3mf_plate(const std::filesystem::path& path, const std::vector<PlatePart>& parts,
                       const std::vector<std::pair<std::string, std::string>>& metadata);

/// One mesh, unit millimetre, coordinates to 1e-5 mm. Metadata names get the prefix "gnathion:" (own names
/// belong in a namespace). Whole or not at all; the same input gives the same bytes.
Status write_3mf(const std::filesystem::path& path, const TriangleMesh& mesh,
                 const std::vector<std::pair<std::string, std::string>>& metadata);

}  // namespace gnathion
