// Closest points, and each stage of a splint's design at 0.1 mm.
#include <benchmark/benchmark.h>

#include "core/mesh_query.h"
#include "core/random.h"
#include "core/time.h"
#include "design/preview.h"
#include "design/splint.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

const PhantomJaws& jaws() {
  static const PhantomJaws instance = make_phantom_jaws(3);
  return instance;
}

void BM_ClosestPoint(benchmark::State& state) {
  static const MeshQuery query(jaws().maxilla);
  Random random(8);
  std::vector<Vector3> points;
  const auto& vertices = query.mesh().vertices_mm;
  for (int i = 0; i < 10000; ++i)
    points.push_back(vertices[random.below(static_cast<std::uint32_t>(vertices.size()))] + random.normal3());
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(query.signed_distance(points[i++ % points.size()]));
}
BENCHMARK(BM_ClosestPoint)->Unit(benchmark::kMicrosecond);

/// The same points in one call, on all cores; per point.
void BM_ClosestPoints(benchmark::State& state) {
  static const MeshQuery query(jaws().maxilla);
  Random random(8);
  std::vector<Vector3> points;
  const auto& vertices = query.mesh().vertices_mm;
  for (int i = 0; i < 1500000; ++i)
    points.push_back(vertices[random.below(static_cast<std::uint32_t>(vertices.size()))] +
                     0.1 * random.normal3());
  for (auto _ : state) benchmark::DoNotOptimize(closest_points(query, points));
  state.counters["s_per_million"] =
      benchmark::Counter(1e-6 * static_cast<double>(points.size()),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_ClosestPoints)->Unit(benchmark::kSecond)->UseRealTime();

/// One design; its stages' seconds and the peak memory stand as counters.
void BM_Design(benchmark::State& state) {
  SplintInputs in{jaws().maxilla, jaws().mandible_mi,
                  Motion<Dental>(Rigid3::about_axis({0, 88, 35}, {1, 0, 0}, 0.05)), std::nullopt};
  SplintParameters parameters;
  parameters.voxel_mm = static_cast<double>(state.range(0)) / 1000.0;
  SilentProgress silent;
  for (auto _ : state) {
    const auto design = design_splint(in, parameters, silent);
    if (!design) {
      state.SkipWithError(design.error().line().c_str());
      return;
    }
    for (const auto& [stage, seconds] : design->timing_s) state.counters[stage + "_s"] = seconds;
    state.counters["triangles"] = static_cast<double>(design->splint.triangles.size());
  }
  state.counters["peak_rss_mib"] = peak_rss_mib();
}
BENCHMARK(BM_Design)
    ->ArgName("voxel_um")
    ->Arg(300)
    ->Arg(200)
    ->Arg(100)
    ->Unit(benchmark::kSecond)
    ->Iterations(1);

/// A preview after one parameter changed there and back, by parameter; processor time beside wall time.
void BM_PreviewAfter(benchmark::State& state, double SplintParameters::*value, double changed) {
  SplintInputs in{jaws().maxilla, jaws().mandible_mi,
                  Motion<Dental>(Rigid3::about_axis({0, 88, 35}, {1, 0, 0}, 0.05)), std::nullopt};
  SplintPreviewer previewer;
  SplintParameters parameters;
  const double before = parameters.*value;
  if (!previewer.build(in, parameters)) {
    state.SkipWithError("no preview");
    return;
  }
  for (auto _ : state) {
    parameters.*value = parameters.*value == before ? changed : before;
    benchmark::DoNotOptimize(previewer.build(in, parameters));
  }
}
#define GNATHION_PREVIEW(name, value)                                      \
  BENCHMARK_CAPTURE(BM_PreviewAfter, name, &SplintParameters::name, value) \
      ->Unit(benchmark::kMillisecond)                                      \
      ->Iterations(4)                                                      \
      ->MeasureProcessCPUTime()                                            \
      ->UseRealTime()
GNATHION_PREVIEW(wall_mm, 1.3);
GNATHION_PREVIEW(gap_mm, 0.15);
GNATHION_PREVIEW(engagement_mm, 0.1);
GNATHION_PREVIEW(draft_deg, 25.0);
GNATHION_PREVIEW(smoothing_mm, 1.5);
GNATHION_PREVIEW(stamp_height_mm, 3.0);
GNATHION_PREVIEW(imprint_depth_mm, 0.8);
GNATHION_PREVIEW(depth_mm, 3.0);
#undef GNATHION_PREVIEW

}  // namespace
}  // namespace gnathion
