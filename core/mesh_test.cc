#include "core/mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/mesh_io.h"
#include "core/mesh_test_shapes.h"

namespace gnathion {
namespace {

TEST(Mesh, BoxMeasures) {
  const TriangleMesh box = test::box({1, 2, 3}, {3, 5, 7});
  EXPECT_DOUBLE_EQ(surface_area_mm2(box), 2 * (2 * 3 + 3 * 4 + 4 * 2));
  EXPECT_DOUBLE_EQ(signed_volume_mm3(box), 24.0);
  EXPECT_LT((surface_centroid_mm(box) - Vector3(2, 3.5, 5)).norm(), 1e-12);
  EXPECT_EQ(bounding_box(box).size_mm(), Vector3(2, 3, 4));
  TriangleMesh turned = box;
  flip_orientation(turned);
  EXPECT_DOUBLE_EQ(signed_volume_mm3(turned), -24.0);
}

TEST(Mesh, SphereMeasuresFarFromTheOrigin) {
  TriangleMesh ball = test::sphere(6, 20.0);
  for (Vector3& v : ball.vertices_mm) v += Vector3(1e7, -1e7, 1e7);
  EXPECT_NEAR(signed_volume_mm3(ball), 4.0 / 3.0 * M_PI * 8000.0, 40.0);  // inscribed: a bit less
  EXPECT_NEAR(surface_area_mm2(ball), 4.0 * M_PI * 400.0, 3.0);
}

TEST(Mesh, RigidMotionKeepsMeasures) {
  Random random(3);
  const TriangleMesh mesh = test::spiky(3, 4);
  const Rigid3 motion{random.rotation(), Vector3(10, 20, -30)};
  const TriangleMesh moved = transformed(motion, mesh);
  EXPECT_NEAR(signed_volume_mm3(moved), signed_volume_mm3(mesh), 1e-6);
  EXPECT_NEAR(surface_area_mm2(moved), surface_area_mm2(mesh), 1e-8);
  EXPECT_LT((surface_centroid_mm(moved) - motion * surface_centroid_mm(mesh)).norm(), 1e-9);
}

TEST(Mesh, NormalsOfSphereConvergeToItsRadii) {
  double worst_deg[2];
  for (int i = 0; i < 2; ++i) {
    const TriangleMesh ball = test::sphere(5 + i, 10.0);
    const std::vector<Vector3> normals = vertex_normals(ball), faces = face_normals(ball);
    double sine = 0.0;
    for (std::size_t v = 0; v < normals.size(); ++v) {
      EXPECT_NEAR(normals[v].norm(), 1.0, 1e-12);
      sine = std::max(sine, normals[v].cross(ball.vertices_mm[v].normalized()).norm());
    }
    worst_deg[i] = std::asin(sine) * 180 / M_PI;
    for (std::size_t f = 0; f < faces.size(); ++f)
      ASSERT_GT(faces[f].dot(ball.corner(f, 0).normalized()), 0.99);
  }
  EXPECT_LT(worst_deg[0], 0.5);  // edges of 3°
  EXPECT_LT(worst_deg[1], 0.6 * worst_deg[0]);
}

TEST(Mesh, CubeCornerNormalDoesNotDependOnTheDiagonals) {
  // Angle weights: each corner's normal is along the diagonal, though some sides meet it with two triangles.
  const TriangleMesh cube = test::box({-1, -1, -1}, {1, 1, 1});
  const std::vector<Vector3> normals = vertex_normals(cube);
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_LT((normals[i] - cube.vertices_mm[i].normalized()).norm(), 1e-12);
}

TEST(Mesh, DegenerateTrianglesHaveNoNormal) {
  TriangleMesh m;
  m.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  m.triangles = {{0, 1, 2}};
  EXPECT_EQ(face_normals(m)[0], Vector3::Zero());
  for (const Vector3& n : vertex_normals(m)) EXPECT_EQ(n, Vector3::Zero());
  EXPECT_EQ(mesh_topology(m).degenerate_triangles, 1u);
}

TriangleMesh soup_of(const TriangleMesh& mesh) {
  TriangleMesh soup;
  for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    for (int k = 0; k < 3; ++k) soup.vertices_mm.push_back(mesh.corner(i, k));
    soup.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return soup;
}

TEST(Mesh, WeldingSoupGivesTheSurfaceBack) {
  const TriangleMesh mesh = test::torus(20, 5, 40, 20);
  const TriangleMesh welded = welded_exactly(soup_of(mesh));
  EXPECT_EQ(welded.vertices_mm.size(), mesh.vertices_mm.size());
  ASSERT_EQ(welded.triangles.size(), mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    for (int k = 0; k < 3; ++k) EXPECT_EQ(welded.corner(i, k), mesh.corner(i, k));
}

TEST(Mesh, WeldingIsExact) {
  TriangleMesh m;
  const double x = 0.1;
  m.vertices_mm = {{x, 0.0, 0}, {1, 0, 0}, {0, 1, 0}, {x, -0.0, 0}, {std::nextafter(x, 1.0), 0, 0},
                   {1, 0, 0}};
  m.colors_rgb = {{1, 1, 1}, {2, 2, 2}, {3, 3, 3}, {4, 4, 4}, {5, 5, 5}, {6, 6, 6}};
  m.triangles = {{0, 1, 2}, {3, 5, 2}, {4, 1, 2}, {0, 3, 1}};
  const TriangleMesh welded = welded_exactly(m);
  EXPECT_EQ(welded.vertices_mm.size(), 4u);  // −0 is 0; the next double is another point
  ASSERT_EQ(welded.triangles.size(), 3u);    // 0 3 1 collapsed
  EXPECT_EQ(welded.triangles[0], welded.triangles[1]);
  EXPECT_NE(welded.triangles[0], welded.triangles[2]);
  EXPECT_EQ(welded.colors_rgb.size(), 4u);
  EXPECT_EQ(welded.colors_rgb[3][0], 5);
}

TEST(Mesh, MergeAndSubmeshAreInverse) {
  TriangleMesh a = test::tetrahedron(), b = test::box({20, 0, 0}, {21, 1, 1});
  a.colors_rgb.assign(4, {255, 0, 0});
  const TriangleMesh uncoloured = merged(a, b);
  EXPECT_TRUE(uncoloured.colors_rgb.empty());
  b.colors_rgb.assign(8, {0, 255, 0});
  const TriangleMesh both = merged(a, b);
  ASSERT_EQ(both.triangles.size(), 16u);
  EXPECT_EQ(both.colors_rgb.size(), 12u);
  std::vector<bool> keep(16, false);
  std::fill(keep.begin() + 4, keep.end(), true);
  const TriangleMesh again = submesh(both, keep);
  EXPECT_EQ(again.vertices_mm, b.vertices_mm);
  EXPECT_EQ(again.triangles, b.triangles);
  EXPECT_EQ(again.colors_rgb, b.colors_rgb);
}

TEST(MeshTopology, ClosedShapes) {
  const struct {
    TriangleMesh mesh;
    long genus;
  } cases[] = {{test::tetrahedron(), 0}, {test::sphere(4, 5), 0}, {test::torus(20, 5, 24, 12), 1}};
  for (const auto& c : cases) {
    const MeshTopology facts = mesh_topology(c.mesh);
    EXPECT_TRUE(facts.watertight());
    EXPECT_TRUE(facts.manifold());
    EXPECT_EQ(facts.components, 1u);
    EXPECT_EQ(facts.genus, c.genus);
    EXPECT_EQ(facts.degenerate_triangles, 0u);
    EXPECT_TRUE(boundary_loops(c.mesh).empty());
  }
  const MeshTopology two = mesh_topology(merged(test::torus(20, 5, 24, 12), test::torus(40, 5, 24, 12)));
  EXPECT_EQ(two.components, 2u);
  EXPECT_EQ(two.genus, 2);
  EXPECT_FALSE(mesh_topology(TriangleMesh()).watertight());
}

TEST(MeshTopology, HolesAndTheirLoops) {
  TriangleMesh ball = test::sphere(4, 5);
  ball.triangles.erase(ball.triangles.begin() + 100);
  ball.triangles.erase(ball.triangles.begin() + 700);
  const MeshTopology facts = mesh_topology(ball);
  EXPECT_FALSE(facts.watertight());
  EXPECT_TRUE(facts.manifold());
  EXPECT_EQ(facts.boundary_edges, 6u);
  EXPECT_EQ(facts.genus, 0);
  const auto loops = boundary_loops(ball);
  ASSERT_EQ(loops.size(), 2u);
  for (const auto& loop : loops) EXPECT_EQ(loop.size(), 3u);
}

TEST(MeshTopology, SheetHasOneLoopInTheDirectionOfItsTriangles) {
  const TriangleMesh sheet = test::sheet(7, 14.0, [](double, double) { return 0.0; });
  const auto loops = boundary_loops(sheet);
  ASSERT_EQ(loops.size(), 1u);
  ASSERT_EQ(loops[0].size(), 28u);
  double twice_area = 0.0;  // positive: counter-clockwise, like the triangles
  for (std::size_t i = 0; i < 28; ++i) {
    const Vector3 &p = sheet.vertices_mm[loops[0][i]], &q = sheet.vertices_mm[loops[0][(i + 1) % 28]];
    EXPECT_DOUBLE_EQ((q - p).norm(), 2.0);
    twice_area += p.x() * q.y() - p.y() * q.x();
  }
  EXPECT_NEAR(twice_area, 2 * 14.0 * 14.0, 1e-9);
}

TEST(MeshTopology, HolesThatTouchInAVertexStayTwoLoops) {
  TriangleMesh sheet = test::sheet(6, 6.0, [](double, double) { return 0.0; });
  // The two quads diagonally across vertex (3,3): quad index j·6 + i, two triangles each.
  std::vector<bool> keep(sheet.triangles.size(), true);
  for (const int quad : {2 * 6 + 2, 3 * 6 + 3}) keep[2 * quad] = keep[2 * quad + 1] = false;
  sheet = submesh(sheet, keep);
  EXPECT_EQ(mesh_topology(sheet).non_manifold_vertices, 1u);
  std::vector<std::size_t> sizes;
  for (const auto& loop : boundary_loops(sheet)) {
    sizes.push_back(loop.size());
    for (std::size_t i = 0; i < loop.size(); ++i)
      EXPECT_NEAR((sheet.vertices_mm[loop[i]] - sheet.vertices_mm[loop[(i + 1) % loop.size()]]).norm(), 1.0,
                  1e-12);
  }
  std::sort(sizes.begin(), sizes.end());
  EXPECT_EQ(sizes, (std::vector<std::size_t>{4, 4, 24}));
}

TEST(MeshTopology, SurfacesThatTouchInAVertexKeepTheirRims) {
  TriangleMesh m = test::sheet(3, 3.0, [](double, double) { return 0.0; });
  m = merged(m, transformed(Rigid3::from_translation({3, 3, 0}), m));
  m = welded_exactly(m);  // corner to corner
  EXPECT_EQ(mesh_topology(m).non_manifold_vertices, 1u);
  const auto loops = boundary_loops(m);
  ASSERT_EQ(loops.size(), 2u);
  EXPECT_EQ(loops[0].size(), 12u);
  EXPECT_EQ(loops[1].size(), 12u);
}

TEST(MeshTopology, NonManifoldEdgesAndVertices) {
  // Two cubes that share one vertex.
  TriangleMesh m = welded_exactly(merged(test::box({0, 0, 0}, {1, 1, 1}), test::box({1, 1, 1}, {2, 2, 2})));
  MeshTopology facts = mesh_topology(m);
  EXPECT_EQ(facts.vertices, 15u);
  EXPECT_EQ(facts.non_manifold_vertices, 1u);
  EXPECT_EQ(facts.non_manifold_edges, 0u);
  EXPECT_EQ(facts.components, 2u);
  EXPECT_EQ(facts.genus, 0);
  EXPECT_TRUE(facts.watertight());
  EXPECT_FALSE(facts.manifold());
  // Two that share an edge.
  m = welded_exactly(merged(test::box({0, 0, 0}, {1, 1, 1}), test::box({1, 1, 0}, {2, 2, 1})));
  facts = mesh_topology(m);
  EXPECT_EQ(facts.non_manifold_edges, 1u);
  EXPECT_EQ(facts.non_manifold_vertices, 0u);
  // One triangle turned over: its three edges are wound alike.
  m = test::sphere(3, 5);
  std::swap(m.triangles[10][0], m.triangles[10][1]);
  facts = mesh_topology(m);
  EXPECT_EQ(facts.non_manifold_edges, 3u);
  EXPECT_EQ(facts.boundary_edges, 0u);
}

TEST(MeshTopology, CollapsedTrianglesChangeNothingElse) {
  TriangleMesh m = test::torus(20, 5, 12, 8);
  const MeshTopology clean = mesh_topology(m);
  m.triangles.push_back({0, 0, 1});
  m.triangles.push_back({5, 5, 5});
  const MeshTopology facts = mesh_topology(m);
  EXPECT_EQ(facts.degenerate_triangles, 2u);
  EXPECT_EQ(facts.components, clean.components);
  EXPECT_EQ(facts.genus, clean.genus);
  EXPECT_TRUE(facts.watertight() && facts.manifold());
}

TEST(MeshTopology, ComponentsAreNumberedByTheirFirstTriangle) {
  TriangleMesh m = merged(merged(test::tetrahedron(), test::box({20, 0, 0}, {21, 1, 1})), test::sphere(2, 1));
  Random random(9);
  for (std::size_t i = m.triangles.size() - 1; i > 0; --i)
    std::swap(m.triangles[i], m.triangles[random.below(std::uint32_t(i + 1))]);
  std::size_t count = 0;
  const auto component = triangle_components(m, &count);
  EXPECT_EQ(count, 3u);
  std::uint32_t seen = 0;
  for (std::size_t i = 0; i < component.size(); ++i) {
    EXPECT_LE(component[i], seen);
    seen = std::max(seen, component[i] + 1);
    for (std::size_t j = 0; j < i; ++j) {
      const bool same_box = (m.corner(i, 0).x() > 15) == (m.corner(j, 0).x() > 15);
      if (component[i] == component[j]) {
        EXPECT_TRUE(same_box);
      }
    }
  }
}

TEST(MeshTopology, BookOfThreePages) {
  TriangleMesh m;
  m.vertices_mm = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
  m.triangles = {{0, 1, 2}, {0, 1, 3}, {0, 1, 4}};
  const MeshTopology facts = mesh_topology(m);
  EXPECT_EQ(facts.non_manifold_edges, 1u);
  EXPECT_EQ(facts.boundary_edges, 6u);
  // Two pages make one closed chain; the third page's two sides close nothing.
  const auto loops = boundary_loops(m);
  ASSERT_EQ(loops.size(), 1u);
  EXPECT_EQ(loops[0].size(), 4u);
}

TEST(MeshTopology, FactsOfRealScans) {
  const auto data = test::shared_data();
  if (data.empty()) GTEST_SKIP() << "skipped: the shared data folder is not here";
  // Figures of data/README.md.
  const auto cast = read_mesh(data / "jaws/cast/maxilla.stl");
  ASSERT_TRUE(cast) << cast.error().line();
  MeshTopology facts = mesh_topology(*cast);
  EXPECT_EQ(facts.triangles, 28156u);
  EXPECT_FALSE(facts.watertight());
  EXPECT_EQ(boundary_loops(*cast).size(), 28u);
  const auto crowns = read_mesh(data / "jaws/crowns/mandible_mi.stl");
  ASSERT_TRUE(crowns) << crowns.error().line();
  facts = mesh_topology(*crowns);
  EXPECT_EQ(facts.triangles, 83262u);
  EXPECT_TRUE(facts.watertight());
  const auto skull = read_mesh(data / "skull/dry_skull/Skull.obj");
  ASSERT_TRUE(skull) << skull.error().line();
  facts = mesh_topology(*skull);
  EXPECT_EQ(facts.triangles, 103514u);
  EXPECT_EQ(facts.non_manifold_edges, 4331u);
}

}  // namespace
}  // namespace gnathion
