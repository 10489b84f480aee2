#include "core/mesh.h"

#include <cmath>
#include <cstring>

#include "core/check.h"
#include "core/mesh_edges.h"

namespace gnathion {
namespace {

constexpr std::uint32_t kNone = 0xffffffffu;

/// Hash of a point by its bits; +0.0 and −0.0 count as equal.
std::uint64_t hash_point(const Vector3& p) {
  std::uint64_t h = 0x9e3779b97f4a7c15ull;
  for (int k = 0; k < 3; ++k) {
    const double value = p[k] + 0.0;
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    h = (h ^ bits) * 0xff51afd7ed558ccdull;
    h ^= h >> 32;
  }
  return h;
}

}  // namespace

std::vector<std::uint32_t> first_equal_vertices(const std::vector<Vector3>& vertices) {
  std::size_t slots = 16;
  while (slots < 2 * vertices.size()) slots *= 2;
  std::vector<std::uint32_t> table(slots, kNone), first(vertices.size());
  for (std::uint32_t i = 0; i < vertices.size(); ++i) {
    std::size_t slot = hash_point(vertices[i]) & (slots - 1);
    while (table[slot] != kNone && vertices[table[slot]] != vertices[i]) slot = (slot + 1) & (slots - 1);
    if (table[slot] == kNone) table[slot] = i;
    first[i] = table[slot];
  }
  return first;
}

Box bounding_box(const TriangleMesh& mesh) {
  Box box;
  for (const Vector3& v : mesh.vertices_mm) box.extend(v);
  return box;
}

TriangleMesh transformed(const Rigid3& motion, const TriangleMesh& mesh) {
  TriangleMesh result = mesh;
  for (Vector3& v : result.vertices_mm) v = motion * v;
  return result;
}

TriangleMesh merged(const TriangleMesh& a, const TriangleMesh& b) {
  GNATHION_CHECK(a.vertices_mm.size() + b.vertices_mm.size() < kNone);
  TriangleMesh result = a;
  const auto offset = static_cast<std::uint32_t>(a.vertices_mm.size());
  result.vertices_mm.insert(result.vertices_mm.end(), b.vertices_mm.begin(), b.vertices_mm.end());
  result.triangles.reserve(a.triangles.size() + b.triangles.size());
  for (const Triangle& t : b.triangles)
    result.triangles.push_back({t[0] + offset, t[1] + offset, t[2] + offset});
  const bool coloured =
      a.colors_rgb.size() == a.vertices_mm.size() && b.colors_rgb.size() == b.vertices_mm.size();
  if (coloured)
    result.colors_rgb.insert(result.colors_rgb.end(), b.colors_rgb.begin(), b.colors_rgb.end());
  else
    result.colors_rgb.clear();
  if (result.texture_file.empty()) result.texture_file = b.texture_file;
  return result;
}

void flip_orientation(TriangleMesh& mesh) {
  for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
}

Vector3 face_normal_scaled(const TriangleMesh& mesh, std::size_t triangle) {
  const Vector3 a = mesh.corner(triangle, 0);
  return (mesh.corner(triangle, 1) - a).cross(mesh.corner(triangle, 2) - a);
}

std::vector<Vector3> face_normals(const TriangleMesh& mesh) {
  std::vector<Vector3> normals(mesh.triangles.size());
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const Vector3 n = face_normal_scaled(mesh, i);
    const double length = n.norm();
    normals[i] = length > 0.0 ? Vector3(n / length) : Vector3::Zero();
  }
  return normals;
}

std::vector<Vector3> vertex_normals(const TriangleMesh& mesh) {
  std::vector<Vector3> normals(mesh.vertices_mm.size(), Vector3::Zero());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Vector3 n = face_normal_scaled(mesh, i);
    const double length = n.norm();
    if (!(length > 0.0)) continue;
    for (int k = 0; k < 3; ++k) {
      const Vector3 p = mesh.corner(i, k);
      const Vector3 u = mesh.corner(i, (k + 1) % 3) - p, v = mesh.corner(i, (k + 2) % 3) - p;
      // |u × v| is the same at each corner; atan2 is exact for slivers too.
      normals[mesh.triangles[i][static_cast<std::size_t>(k)]] += std::atan2(length, u.dot(v)) / length * n;
    }
  }
  for (Vector3& n : normals) {
    const double length = n.norm();
    if (length > 0.0) n /= length;
  }
  return normals;
}

double surface_area_mm2(const TriangleMesh& mesh) {
  double twice = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) twice += face_normal_scaled(mesh, i).norm();
  return 0.5 * twice;
}

double signed_volume_mm3(const TriangleMesh& mesh) {
  if (mesh.empty()) return 0.0;
  // Relative to the middle of the mesh, so that a mesh far from the origin loses no digits.
  const Vector3 o = bounding_box(mesh).centre_mm();
  double six_fold = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Vector3 a = mesh.corner(i, 0) - o, b = mesh.corner(i, 1) - o, c = mesh.corner(i, 2) - o;
    six_fold += a.dot(b.cross(c));
  }
  return six_fold / 6.0;
}

Vector3 surface_centroid_mm(const TriangleMesh& mesh) {
  Vector3 sum = Vector3::Zero();
  double weight = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const double area = face_normal_scaled(mesh, i).norm();
    sum += area / 3.0 * (mesh.corner(i, 0) + mesh.corner(i, 1) + mesh.corner(i, 2));
    weight += area;
  }
  if (weight > 0.0) return sum / weight;
  return mesh.vertices_mm.empty() ? Vector3(Vector3::Zero()) : bounding_box(mesh).centre_mm();
}

TriangleMesh welded_exactly(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> first = first_equal_vertices(mesh.vertices_mm);
  const bool coloured = mesh.colors_rgb.size() == mesh.vertices_mm.size();
  TriangleMesh result;
  result.texture_file = mesh.texture_file;
  std::vector<std::uint32_t> index(first.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    if (first[i] != i) {
      index[i] = index[first[i]];
      continue;
    }
    index[i] = static_cast<std::uint32_t>(result.vertices_mm.size());
    result.vertices_mm.push_back(mesh.vertices_mm[i]);
    if (coloured) result.colors_rgb.push_back(mesh.colors_rgb[i]);
  }
  result.triangles.reserve(mesh.triangles.size());
  for (const Triangle& t : mesh.triangles) {
    const Triangle n{index[t[0]], index[t[1]], index[t[2]]};
    if (n[0] != n[1] && n[1] != n[2] && n[2] != n[0]) result.triangles.push_back(n);
  }
  return result;
}

TriangleMesh submesh(const TriangleMesh& mesh, const std::vector<bool>& keep_triangle) {
  GNATHION_CHECK(keep_triangle.size() == mesh.triangles.size());
  const bool coloured = mesh.colors_rgb.size() == mesh.vertices_mm.size();
  std::vector<std::uint32_t> index(mesh.vertices_mm.size(), kNone);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    if (keep_triangle[i])
      for (std::uint32_t v : mesh.triangles[i]) index[v] = 0;
  TriangleMesh result;
  result.texture_file = mesh.texture_file;
  for (std::size_t i = 0; i < index.size(); ++i) {  // vertices keep their order
    if (index[i] == kNone) continue;
    index[i] = static_cast<std::uint32_t>(result.vertices_mm.size());
    result.vertices_mm.push_back(mesh.vertices_mm[i]);
    if (coloured) result.colors_rgb.push_back(mesh.colors_rgb[i]);
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!keep_triangle[i]) continue;
    const Triangle& t = mesh.triangles[i];
    result.triangles.push_back({index[t[0]], index[t[1]], index[t[2]]});
  }
  return result;
}

}  // namespace gnathion
