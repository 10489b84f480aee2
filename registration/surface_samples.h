// Points spread evenly over a surface, whatever its tessellation.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// Parallel arrays: point, unit outward normal, and the triangle that it lies on.
struct SurfaceSamples {
  std::vector<Vector3> points_mm;
  std::vector<Vector3> normals;
  std::vector<std::uint32_t> triangles;

  std::size_t size() const { return points_mm.size(); }
  void push_back(const Vector3& p, const Vector3& n, std::uint32_t triangle) {
    points_mm.push_back(p);
    normals.push_back(n);
    triangles.push_back(triangle);
  }
};

/// True for triangles all of whose corners are in the mask; all true for an empty mask.
std::vector<bool> triangles_of_mask(const TriangleMesh& mesh, const std::vector<bool>& vertex_mask);
/// Area (mm²) of the triangles that are kept.
double kept_area_mm2(const TriangleMesh& mesh, const std::vector<bool>& keep);

/// About `count` points, stratified over the area of the kept triangles (systematic sampling over the running
/// area), with face normals. Deterministic for a seed.
SurfaceSamples sample_surface(const TriangleMesh& mesh, const std::vector<bool>& keep, std::size_t count,
                              std::uint64_t seed);

/// At most `count` of the kept triangles' vertices, spread as above, each once, with the normals of the whole
/// mesh there. Where a scan meets a CAD surface: vertices were measured, what lies between them is a chord
/// and sags below a curved surface.
SurfaceSamples sample_vertices(const TriangleMesh& mesh, const std::vector<bool>& keep, std::size_t count,
                               std::uint64_t seed);

/// A subset no two points of which are closer than `spacing_mm` on like-oriented surface, in an order that
/// depends on the samples alone; normals are averaged over the dense samples within `normal_radius_mm` that
/// face alike.
SurfaceSamples thinned(const SurfaceSamples& dense, double spacing_mm, double normal_radius_mm);

}  // namespace gnathion
