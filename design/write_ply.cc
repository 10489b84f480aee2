#include "design/write_ply.h"

#include <bit>
#include <cstring>

#include <fmt/format.h>

#include "core/file.h"

namespace gnathion {
namespace {

static_assert(std::endian::native == std::endian::little, "values are copied as they are");
constexpr std::size_t kVertexBytes = 3 * 4 + 4 + 1, kTriangleBytes = 1 + 3 * 4;

std::string header(std::size_t vertices, std::size_t triangles) {
  return fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment Gnathion splint, mm\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\nproperty float thickness_mm\n"
      "property uchar part\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
      vertices, triangles);
}

template <class T>
void put(std::string& to, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  to.append(bytes, sizeof(T));
}
template <class T>
T take(const char*& at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  at += sizeof(T);
  return value;
}

void put_triangles(std::string& to, const TriangleMesh& mesh) {
  for (const Triangle& t : mesh.triangles) {
    put(to, std::uint8_t{3});
    for (const std::uint32_t v : t) put(to, static_cast<std::int32_t>(v));
  }
}

/// The whole number after the first `key` in the text.
std::size_t number_after(const std::string& text, const std::string& key) {
  const std::size_t at = text.find(key);
  return at == std::string::npos ? 0 : std::strtoull(text.c_str() + at + key.size(), nullptr, 10);
}

}  // namespace

Status write_splint_ply(const std::filesystem::path& path, const SplintSurface& splint) {
  const TriangleMesh& mesh = splint.mesh;
  if (splint.thickness_mm.size() != mesh.vertices_mm.size() || splint.part.size() != mesh.vertices_mm.size())
    return fail(ErrorCode::kInternal, "cannot write splint", path.string(), "a value per vertex is missing");
  std::string bytes = header(mesh.vertices_mm.size(), mesh.triangles.size());
  bytes.reserve(bytes.size() + mesh.vertices_mm.size() * kVertexBytes +
                mesh.triangles.size() * kTriangleBytes);
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    for (int k = 0; k < 3; ++k) put(bytes, static_cast<float>(mesh.vertices_mm[v][k]));
    put(bytes, splint.thickness_mm[v]);
    put(bytes, splint.part[v]);
  }
  put_triangles(bytes, mesh);
  return write_file(path, bytes);
}

Status write_value_ply(const std::filesystem::path& path, const TriangleMesh& mesh, const std::string& name,
                       const std::vector<float>& values) {
  if (values.size() != mesh.vertices_mm.size())
    return fail(ErrorCode::kInternal, "cannot write mesh", path.string(), "a value per vertex is missing");
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment Gnathion, mm\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\nproperty float {}\n"
      "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices_mm.size(), name, mesh.triangles.size());
  for (std::size_t v = 0; v < values.size(); ++v) {
    for (int k = 0; k < 3; ++k) put(bytes, static_cast<float>(mesh.vertices_mm[v][k]));
    put(bytes, values[v]);
  }
  put_triangles(bytes, mesh);
  return write_file(path, bytes);
}

Result<SplintSurface> read_splint_ply(const std::filesystem::path& path) {
  GNATHION_TRY(const std::string bytes, read_file(path));
  const auto refuse = [&](const char* why) { return bad_input("cannot read splint", path.string(), why); };
  const std::string head = bytes.substr(0, 600);
  const std::size_t vertices = number_after(head, "element vertex "),
                    triangles = number_after(head, "element face ");
  const std::string expected = header(vertices, triangles);
  if (bytes.compare(0, expected.size(), expected) != 0)
    return refuse("not a splint.ply as `gnathion design` writes it: design it again");
  const std::size_t body = bytes.size() - expected.size();
  if (vertices > body || triangles > body || body != vertices * kVertexBytes + triangles * kTriangleBytes)
    return refuse("truncated, or longer than it says");
  SplintSurface out;
  const char* at = bytes.data() + expected.size();
  for (std::size_t v = 0; v < vertices; ++v) {
    Vector3 p;
    for (int k = 0; k < 3; ++k) p[k] = take<float>(at);
    if (!p.allFinite()) return refuse("a coordinate is not a number");
    out.mesh.vertices_mm.push_back(p);
    out.thickness_mm.push_back(take<float>(at));
    out.part.push_back(take<std::uint8_t>(at));
  }
  for (std::size_t t = 0; t < triangles; ++t) {
    if (take<std::uint8_t>(at) != 3) return refuse("a face is no triangle");
    Triangle triangle{};
    for (std::uint32_t& v : triangle) {
      v = take<std::uint32_t>(at);
      if (v >= vertices) return refuse("a vertex index is out of range");
    }
    out.mesh.triangles.push_back(triangle);
  }
  return out;
}

}  // namespace gnathion
