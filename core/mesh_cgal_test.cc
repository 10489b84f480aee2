// Self-intersections and distances judged by CGAL, a tool that shares nothing with ours. CGAL's mesh
// processing is GPL: it is used by this test alone and never shipped. Without it the file is empty.
#if __has_include(<CGAL/version.h>)
#define CGAL_DISABLE_GMP 1  // Boost's numbers do as well, and need no library

#include <gtest/gtest.h>

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/box_intersection_d.h>

#include <algorithm>
#include <iostream>

#include "core/check.h"
#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/mesh_test_shapes.h"

namespace gnathion {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Pairs = std::vector<std::array<std::uint32_t, 2>>;

Kernel::Point_3 point(const Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

Pairs sorted(Pairs pairs) {
  for (auto& pair : pairs)
    if (pair[0] > pair[1]) std::swap(pair[0], pair[1]);
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

/// CGAL's own answer; the mesh must be manifold.
Pairs by_cgal(const TriangleMesh& mesh) {
  using Surface = CGAL::Surface_mesh<Kernel::Point_3>;
  Surface surface;
  std::vector<Surface::Vertex_index> vertices;
  for (const Vector3& v : mesh.vertices_mm) vertices.push_back(surface.add_vertex(point(v)));
  for (const Triangle& t : mesh.triangles)
    GNATHION_CHECK(surface.add_face(vertices[t[0]], vertices[t[1]], vertices[t[2]]) != Surface::null_face());
  std::vector<std::pair<Surface::Face_index, Surface::Face_index>> found;
  CGAL::Polygon_mesh_processing::self_intersections(surface, std::back_inserter(found));
  Pairs pairs;
  for (const auto& [a, b] : found)
    pairs.push_back({static_cast<std::uint32_t>(a.idx()), static_cast<std::uint32_t>(b.idx())});
  return sorted(pairs);
}

/// For meshes that CGAL's data structures do not hold: its boxes and exact predicates pair by pair.
Pairs by_cgal_predicates(const TriangleMesh& mesh) {
  using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 3, std::uint32_t>;
  std::vector<Box> boxes;
  std::vector<Kernel::Triangle_3> triangles;
  for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    triangles.emplace_back(point(mesh.corner(i, 0)), point(mesh.corner(i, 1)), point(mesh.corner(i, 2)));
    if (!triangles.back().is_degenerate()) boxes.emplace_back(triangles.back().bbox(), i);
  }
  Pairs pairs;
  CGAL::box_self_intersection_d(boxes.begin(), boxes.end(), [&](const Box& x, const Box& y) {
    const Kernel::Triangle_3 &p = triangles[x.info()], &q = triangles[y.info()];
    std::vector<std::pair<int, int>> shared;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        if (p[i] == q[j]) shared.emplace_back(i, j);
    bool meet = true;
    if (shared.empty()) meet = CGAL::do_intersect(p, q);
    if (shared.size() == 1) {
      const auto [i, j] = shared[0];
      meet = CGAL::do_intersect(Kernel::Segment_3(p[i + 1], p[i + 2]), q) ||
             CGAL::do_intersect(Kernel::Segment_3(q[j + 1], q[j + 2]), p);
    }
    if (shared.size() == 2) {
      const auto &a = p[shared[0].first], &b = p[shared[1].first];
      const auto &c = p[3 - shared[0].first - shared[1].first],
                 &d = q[3 - shared[0].second - shared[1].second];
      meet = CGAL::coplanar(a, b, c, d) && CGAL::coplanar_orientation(a, b, c, d) == CGAL::POSITIVE;
    }
    if (meet) pairs.push_back({x.info(), y.info()});
  });
  return sorted(pairs);
}

TEST(MeshCgal, SelfIntersectionsOfCrumpledSpheres) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Random random(seed);
    TriangleMesh mesh = test::sphere(4, 10.0);
    for (Vector3& v : mesh.vertices_mm) v += 0.15 * double(seed) * random.normal3();
    const Pairs ours = self_intersections(mesh);
    if (seed > 2) {
      EXPECT_GT(ours.size(), 100u);
    }
    EXPECT_EQ(ours, by_cgal(mesh));
    EXPECT_EQ(ours, by_cgal_predicates(mesh));
    // On a coarse grid vertices lie on sides and in planes of other triangles.
    for (Vector3& v : mesh.vertices_mm) v = Vector3((v * 2.0).array().round() / 2.0);
    mesh = welded_exactly(mesh);
    EXPECT_EQ(self_intersections(mesh), by_cgal_predicates(mesh));
  }
}

TEST(MeshCgal, SelfIntersectionsOfRealMeshes) {
  const auto data = test::shared_data();
  if (data.empty()) GTEST_SKIP() << "skipped: the shared data folder is not here";
  for (const char* name : {"jaws/cast/maxilla.stl", "jaws/crowns/mandible_mi.stl",
                           "skull/dry_skull/Mandible.obj", "skull/dry_skull/Skull.obj"}) {
    const auto mesh = read_mesh(data / name);
    ASSERT_TRUE(mesh) << mesh.error().line();
    const Pairs ours = self_intersections(*mesh);
    EXPECT_EQ(ours, by_cgal_predicates(*mesh)) << name;
    std::cout << name << ": " << ours.size() << " pairs\n";
  }
}

TEST(MeshCgal, ClosestPointsOnRealJaw) {
  const auto data = test::shared_data();
  if (data.empty()) GTEST_SKIP() << "skipped: the shared data folder is not here";
  const auto mesh = read_mesh(data / "jaws/crowns/maxilla.stl");
  ASSERT_TRUE(mesh) << mesh.error().line();
  std::vector<Kernel::Triangle_3> triangles;
  for (std::size_t i = 0; i < mesh->triangles.size(); ++i)
    triangles.emplace_back(point(mesh->corner(i, 0)), point(mesh->corner(i, 1)), point(mesh->corner(i, 2)));
  using Primitive = CGAL::AABB_triangle_primitive<Kernel, std::vector<Kernel::Triangle_3>::const_iterator>;
  CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>> tree(triangles.begin(), triangles.end());
  const MeshQuery query(*mesh);
  Random random(3);
  for (int i = 0; i < 3000; ++i) {
    const Vector3 p = mesh->vertices_mm[random.below(std::uint32_t(mesh->vertices_mm.size()))] +
                      random.uniform(0.0, 5.0) * random.normal3();
    const double expected = std::sqrt(CGAL::to_double(tree.squared_distance(point(p))));
    ASSERT_NEAR(query.closest(p)->distance_mm, expected, 1e-9);
  }
}

}  // namespace
}  // namespace gnathion

#endif
