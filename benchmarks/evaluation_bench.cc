// The cost of the evaluation's steps.
#include <benchmark/benchmark.h>

#include <atomic>

#include "core/random.h"
#include "evaluation/surface_distance.h"

namespace gnathion {
namespace {

/// A curved, cusped sheet of a jaw's size: 500 x 500 cells, two triangles each.
TriangleMesh cusped_sheet(int cells) {
  TriangleMesh mesh;
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i <= cells; ++i) {
      const double u = static_cast<double>(i) / cells, v = static_cast<double>(j) / cells;
      const double angle = M_PI * (u - 0.5) * 1.3, radius = 26.0 + 10.0 * (v - 0.5);
      mesh.vertices_mm.emplace_back(
          radius * std::sin(angle), 40.0 - 1.5 * radius * std::cos(angle),
          1.5 * std::cos(60.0 * u) * std::cos(9.0 * v) - 40.0 * std::pow(v - 0.5, 2));
    }
  for (int j = 0; j < cells; ++j)
    for (int i = 0; i < cells; ++i) {
      const auto at = [&](int a, int b) { return static_cast<std::uint32_t>(b * (cells + 1) + a); };
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return mesh;
}

std::vector<Vector3> scattered_about(const TriangleMesh& mesh, std::size_t count, double sigma_mm) {
  Random random(7);
  std::vector<Vector3> points(count);
  for (Vector3& p : points) {
    const auto t = random.below(static_cast<std::uint32_t>(mesh.triangles.size()));
    double u = random.uniform(), v = random.uniform();
    if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
    p = (1.0 - u - v) * mesh.corner(t, 0) + u * mesh.corner(t, 1) + v * mesh.corner(t, 2) +
        sigma_mm * random.normal3();
  }
  return points;
}

/// 1.5 million points against a 500k-triangle model, the model's preparation included. Limit: 1.5 s on 2
/// cores.
void BM_SignedDistances(benchmark::State& state) {
  const TriangleMesh mesh = cusped_sheet(500);
  const std::vector<Vector3> points = scattered_about(mesh, 1500000, 0.1);
  std::vector<float> distance(points.size());
  for (auto _ : state) {
    const SurfaceDistance surface(mesh);
    surface.for_each(points, Rigid3::identity(), 3.0, [&](std::size_t i, const SurfaceFoot& foot) {
      distance[i] = static_cast<float>(foot.signed_mm);
    });
    benchmark::DoNotOptimize(distance.data());
  }
  state.counters["points"] = static_cast<double>(points.size());
  state.counters["triangles"] = static_cast<double>(mesh.triangles.size());
}
BENCHMARK(BM_SignedDistances)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace gnathion
