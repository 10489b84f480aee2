// Mesh files: STL (binary, ASCII), PLY (binary of both endians, ASCII), OBJ. Millimetres.
#pragma once

#include <filesystem>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

enum class MeshFormat { kStlBinary, kStlAscii, kPlyBinary, kPlyBinaryBigEndian, kPlyAscii, kObj };

/// Reads any of the formats; the kind is told by content first, then by extension (a binary STL may
/// begin with "solid"). STL's duplicate vertices are welded exactly. Refused with kInput: unreadable,
/// truncated, empty, NaN or infinite coordinates, indices out of range, only degenerate triangles.
Result<TriangleMesh> read_mesh(const std::filesystem::path& path);
/// The same from memory; `name` stands in errors and gives the extension.
Result<TriangleMesh> parse_mesh(const std::string& bytes, const std::string& name);

/// Format by extension (.stl, .ply, .obj: the binary kind where there is one). Whole or not at all.
Status write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);
Status write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh, MeshFormat format);
std::string format_mesh(const TriangleMesh& mesh, MeshFormat format);

/// Reads a dental arch: read_mesh, then its size must be a jaw's in millimetres. A jaw 0.06 or 60000
/// units wide is refused with the likely unit named (metres, micrometres; inches, centimetres).
Result<TriangleMesh> read_jaw(const std::filesystem::path& path);
/// The check of read_jaw alone; `name` stands in the error.
Status check_jaw_size(const TriangleMesh& mesh, const std::string& name);

}  // namespace gnathion
