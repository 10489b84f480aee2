// PLY with what the design knows of each vertex beside its place.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

/// A splint with the thickness of its wall and the part of the construction, per vertex.
struct SplintSurface {
  TriangleMesh mesh;
  /// Distance to the other side of the wall, mm; negative on rims and walls of apertures, which have none.
  std::vector<float> thickness_mm;
  std::vector<std::uint8_t> part;  ///< SurfacePart of splint_field.h; 0 is the cavity
};

/// Binary PLY: x, y, z, thickness_mm (float) and part (uchar). Whole or not at all; same input, same bytes.
Status write_splint_ply(const std::filesystem::path& path, const SplintSurface& splint);

/// Binary PLY: x, y, z and one named value (float) per vertex. Whole or not at all.
Status write_value_ply(const std::filesystem::path& path, const TriangleMesh& mesh, const std::string& name,
                       const std::vector<float>& values);

/// Reads what write_splint_ply() wrote, and nothing else (kInput).
Result<SplintSurface> read_splint_ply(const std::filesystem::path& path);

}  // namespace gnathion
