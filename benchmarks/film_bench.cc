// The phantom's film: one frame of the camera, still and with motion blur.
#include <benchmark/benchmark.h>

#include "phantom/film_scene.h"
#include "phantom/renderer.h"

namespace gnathion {
namespace {

struct Studio {
  FilmScene scene;
  CameraRenderer renderer;
};

const Studio& studio() {
  static const Studio made = [] {
    FilmScene scene = film_scene(make_phantom_patient(1));
    auto renderer = CameraRenderer::create(
        scene.rig.cameras[0].model,
        {{scene.rig.head_frame, scene.head_surface}, {scene.rig.bow, scene.bow_surface}}, RenderOptions{});
    return Studio{std::move(scene), std::move(renderer.value())};
  }();
  return made;
}

void BM_FilmFrame(benchmark::State& state) {
  const Studio& s = studio();
  const PhantomFilm film(s.scene, FilmOptions{});
  const FilmTruth truth = film.truth_at({1'300'000'000});
  std::vector<BodyExposure> exposures{{truth.camera_from_head.rigid, {}}, {truth.camera_from_bow.rigid, {}}};
  if (state.range(0) > 1)
    exposures[1].path.assign(static_cast<std::size_t>(state.range(0)), truth.camera_from_bow.rigid);
  std::uint32_t frame = 0;
  for (auto _ : state) benchmark::DoNotOptimize(s.renderer.render(exposures, frame++).pixels.data());
}
BENCHMARK(BM_FilmFrame)->ArgName("sub_exposures")->Arg(1)->Arg(4)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace gnathion
