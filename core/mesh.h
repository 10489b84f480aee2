// Triangle meshes and their topology.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

using Triangle = std::array<std::uint32_t, 3>;

/// Indexed triangles; counter-clockwise seen from outside.
struct TriangleMesh {
  std::vector<Vector3> vertices_mm;
  std::vector<Triangle> triangles;
  /// Per vertex, or empty.
  std::vector<std::array<std::uint8_t, 3>> colors_rgb;
  /// Name of the texture image that an OBJ's material refers to, or empty.
  std::string texture_file;

  bool empty() const { return triangles.empty(); }
  Vector3 corner(std::size_t triangle, int k) const {
    return vertices_mm[triangles[triangle][static_cast<std::size_t>(k)]];
  }
};

struct Box {
  Vector3 min_mm = Vector3::Constant(1e300);
  Vector3 max_mm = Vector3::Constant(-1e300);
  void extend(const Vector3& p) {
    min_mm = min_mm.cwiseMin(p);
    max_mm = max_mm.cwiseMax(p);
  }
  Vector3 size_mm() const { return max_mm - min_mm; }
  Vector3 centre_mm() const { return 0.5 * (min_mm + max_mm); }
};

Box bounding_box(const TriangleMesh& mesh);
TriangleMesh transformed(const Rigid3& motion, const TriangleMesh& mesh);
/// `b`'s triangles after `a`'s. Colours are kept where both have them.
TriangleMesh merged(const TriangleMesh& a, const TriangleMesh& b);
void flip_orientation(TriangleMesh& mesh);

/// Unnormalised (length = 2·area) face normal.
Vector3 face_normal_scaled(const TriangleMesh& mesh, std::size_t triangle);
std::vector<Vector3> face_normals(const TriangleMesh& mesh);    ///< unit; zero for degenerate
std::vector<Vector3> vertex_normals(const TriangleMesh& mesh);  ///< angle-weighted, unit
double surface_area_mm2(const TriangleMesh& mesh);
/// By the divergence theorem; meaningful for closed meshes.
double signed_volume_mm3(const TriangleMesh& mesh);
/// Area-weighted centroid of the surface.
Vector3 surface_centroid_mm(const TriangleMesh& mesh);

/// Merges vertices whose three coordinates are equal (exactly); drops triangles that collapse.
TriangleMesh welded_exactly(const TriangleMesh& mesh);
/// Keeps triangles for which keep[i] is true, and only the vertices that they use.
TriangleMesh submesh(const TriangleMesh& mesh, const std::vector<bool>& keep_triangle);
/// Component index of each triangle (sharing an edge), numbered from 0 by first triangle.
std::vector<std::uint32_t> triangle_components(const TriangleMesh& mesh, std::size_t* count);

/// Facts about how triangles meet.
struct MeshTopology {
  std::size_t vertices = 0, triangles = 0, components = 0;
  std::size_t boundary_edges = 0;         ///< one triangle
  std::size_t non_manifold_edges = 0;     ///< three or more triangles, or two wound alike
  std::size_t non_manifold_vertices = 0;  ///< whose triangles form more than one fan
  std::size_t degenerate_triangles = 0;   ///< repeated index or zero area
  long genus = 0;                         ///< of the closed surface, summed over components
  bool watertight() const { return boundary_edges == 0 && triangles > 0; }
  bool manifold() const { return non_manifold_edges == 0 && non_manifold_vertices == 0; }
};
MeshTopology mesh_topology(const TriangleMesh& mesh);

/// Boundary loops as closed vertex chains (the first vertex is not repeated).
std::vector<std::vector<std::uint32_t>> boundary_loops(const TriangleMesh& mesh);

}  // namespace gnathion
