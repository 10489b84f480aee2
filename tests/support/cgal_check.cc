#include "tests/support/cgal_check.h"

#define CGAL_DISABLE_GMP 1  // Boost's numbers do as well, and need no library

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

namespace gnathion::testing {

CgalVerdict judge_by_cgal(const TriangleMesh& mesh) {
  namespace PMP = CGAL::Polygon_mesh_processing;
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  std::vector<Kernel::Point_3> points;
  for (const Vector3& v : mesh.vertices_mm) points.emplace_back(v.x(), v.y(), v.z());
  std::vector<std::vector<std::size_t>> polygons;
  for (const Triangle& t : mesh.triangles) polygons.push_back({t[0], t[1], t[2]});
  CgalVerdict verdict;
  verdict.is_polygon_mesh = PMP::is_polygon_soup_a_polygon_mesh(polygons);
  if (!verdict.is_polygon_mesh) return verdict;
  CGAL::Surface_mesh<Kernel::Point_3> surface;
  PMP::polygon_soup_to_polygon_mesh(points, polygons, surface);
  verdict.closed = CGAL::is_closed(surface);
  verdict.outward = verdict.closed && PMP::is_outward_oriented(surface);
  auto component = surface.add_property_map<decltype(surface)::Face_index, std::size_t>("f:component").first;
  verdict.components = PMP::connected_components(surface, component);
  verdict.self_intersects = PMP::does_self_intersect(surface);
  return verdict;
}

}  // namespace gnathion::testing
