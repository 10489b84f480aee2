// One step of virtual X-rays: both joints at 256×256 from a volume of 0.3 mm voxels. The part that moves is
// as large as a condyle with its neck and the ramus below, 26 × 22 × 45 mm.
#include <benchmark/benchmark.h>

#include "anatomy/xray.h"

namespace gnathion {
namespace {

Volume head() {
  Volume v;
  v.grid.size = {240, 240, 240};
  v.grid.step_mm = 0.3 * Matrix3::Identity();
  v.grid.origin_mm = Vector3::Constant(-0.15 * 239);
  v.voxels16.assign(v.grid.count(), 50);
  return v;
}

VoxelMask part() {
  VoxelMask mask;
  mask.low = {77, 84, 30};
  mask.size = {86, 73, 150};
  mask.inside.assign(static_cast<std::size_t>(86) * 73 * 150, 1);
  return mask;
}

void BM_XrayStepOfBothJoints(benchmark::State& state) {
  const Volume volume = head();
  const ArchFrame arch;
  const auto view = named_view(state.range(0) == 0   ? "lateral"
                               : state.range(0) == 1 ? "frontal"
                                                     : "towne",
                               arch);
  const auto xray = JointXray::create(volume, Transform<Cbct, Dental>(), part(), Vector3::Zero(), *view, {});
  double turn = 0.0;
  for (auto _ : state) {
    turn += 0.002;
    const Motion<Dental> motion(Rigid3::about_axis({0, 10, 5}, Vector3::UnitX(), turn));
    for (int joint = 0; joint < 2; ++joint) benchmark::DoNotOptimize(xray->film(motion));
  }
  state.counters["steps_per_s"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(BM_XrayStepOfBothJoints)->DenseRange(0, 2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace gnathion
