#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "core/file.h"
#include "rendering/plot.h"
#include "rendering/scene.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

/// A closed box with outward triangles.
TriangleMesh box(const Vector3& low, const Vector3& high) {
  TriangleMesh m;
  for (int i = 0; i < 8; ++i)
    m.vertices_mm.emplace_back(i & 1 ? high.x() : low.x(), i & 2 ? high.y() : low.y(),
                               i & 4 ? high.z() : low.z());
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

double length(const Polyline2& line) {
  double sum = 0;
  for (std::size_t i = 1; i < line.size(); ++i) sum += (line[i] - line[i - 1]).norm();
  return sum;
}

TEST(CutMesh, BoxGivesOneClosedRectangle) {
  const SectionPlane plane{{0, 0, 1.5}, Vector3::UnitX(), Vector3::UnitY()};
  const auto chains = cut_mesh(box({-1, -2, 0}, {3, 4, 5}), plane);
  ASSERT_EQ(chains.size(), 1u);
  EXPECT_EQ(chains[0].front(), chains[0].back());
  EXPECT_NEAR(length(chains[0]), 2 * (4 + 6), 1e-9);
}

TEST(CutMesh, OpenMeshGivesAnOpenChainAndPlaneThroughVerticesIsSafe) {
  TriangleMesh open = box({0, 0, 0}, {2, 2, 2});
  open.triangles.resize(10);  // without the side x = high
  const auto chains = cut_mesh(open, {{0, 0, 1}, Vector3::UnitX(), Vector3::UnitY()});
  ASSERT_EQ(chains.size(), 1u);
  EXPECT_NEAR(length(chains[0]), 6.0, 1e-9);
  EXPECT_NEAR(
      length(cut_mesh(box({0, 0, 0}, {2, 2, 2}), {{0, 0, 2}, Vector3::UnitX(), Vector3::UnitY()}).at(0)), 8.0,
      1e-6);
  EXPECT_TRUE(cut_mesh(open, {{0, 0, 9}, Vector3::UnitX(), Vector3::UnitY()}).empty());
}

TEST(Pictures, SceneAndPlotComeOutAsPng) {
  const fs::path folder = fs::temp_directory_path() / ("gnathion_pictures_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const TriangleMesh m = box({0, 0, 0}, {10, 20, 5});
  SceneMesh solid, clear;
  solid.mesh = clear.mesh = &m;
  clear.opacity = 0.5;
  ASSERT_TRUE(render_scene(folder / "scene.png", {solid, clear}, {}, {{1, 1, 1}, Vector3::UnitZ()}, {}));
  PlotOptions o;
  o.title = "A box";
  ASSERT_TRUE(plot_curves(folder / "plot.png", {{"box", palette::kMaxilla, 2, cut_mesh(m, {{0, 0, 1}})}}, o));
  for (const char* name : {"scene.png", "plot.png"}) {
    const auto bytes = read_file(folder / name);
    ASSERT_TRUE(bytes);
    EXPECT_EQ(bytes->substr(1, 3), "PNG");
    EXPECT_GT(bytes->size(), 4000u) << name << " looks empty";
  }
  fs::remove_all(folder);
}

}  // namespace
}  // namespace gnathion
