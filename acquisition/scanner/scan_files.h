// The files that make up one exported scan, and what can be said of them without knowing who scans.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

/// Files that a mesh file refers to, as it names them: the material library of an OBJ, textures of an MTL and
/// of a PLY ("comment TextureFile"). Any bytes are accepted.
std::vector<std::string> referred_files(const std::string& name, const std::string& bytes);
/// A reference as a name inside the scan's own folder: directories that an exporter's machine had are
/// dropped.
std::string local_name(const std::string& reference);

/// "metres", "centimetres", … when a mesh's size is not that of a face in millimetres (80 to 800 mm); nothing
/// when it is. "an unknown unit" when none fits.
std::optional<std::string> suspected_unit(const TriangleMesh& mesh);

}  // namespace gnathion
