// Tags and poses on frames of the virtual patient: the whole frame searched, tags followed, poses.
#include <benchmark/benchmark.h>

#include "phantom/film.h"
#include "phantom/film_scene.h"
#include "tracking/body_tracker.h"

namespace gnathion {
namespace {

struct Footage {
  Rig rig;
  std::vector<FrameSample> frames;
};

/// A second of rest, rendered once.
const Footage& footage() {
  static const Footage instance = [] {
    const PhantomPatient patient = make_phantom_patient(3);
    FilmOptions options;
    options.border_movements = false;
    options.duration_s = 8;
    Footage f;
    f.rig = phantom_rig(patient);
    PhantomFilm film(film_scene(patient), options);
    while (f.frames.size() < 60) {
      auto sample = film.next();
      if (!sample || !*sample) break;
      if (auto* frame = std::get_if<FrameSample>(&**sample)) f.frames.push_back(std::move(*frame));
    }
    return f;
  }();
  return instance;
}

void BM_TagsWholeFrame(benchmark::State& state) {
  const Footage& f = footage();
  auto detector = TagDetector::create({});
  std::size_t i = 0, tags = 0;
  for (auto _ : state)
    tags += (*detector)->detect(f.frames[i++ % f.frames.size()].image, f.rig.cameras[0].model).size();
  state.counters["tags"] = static_cast<double>(tags) / static_cast<double>(state.iterations());
}
BENCHMARK(BM_TagsWholeFrame)->Unit(benchmark::kMillisecond);

void BM_TagsAndPosesTracked(benchmark::State& state) {
  const Footage& f = footage();
  auto tracker = BodyTracker::create(f.rig, {});
  std::size_t i = 0, valid = 0;
  for (auto _ : state) {
    if (i == f.frames.size()) {
      state.PauseTiming();
      (*tracker)->reset();
      i = 0;
      (*tracker)->next(f.frames[0].header.capture, {&f.frames[0].image});
      i = 1;
      state.ResumeTiming();
    }
    const BodyPoses poses = (*tracker)->next(f.frames[i].header.capture, {&f.frames[i].image});
    valid += poses.bow.valid && poses.head.valid;
    ++i;
  }
  state.counters["valid"] = static_cast<double>(valid) / static_cast<double>(state.iterations());
}
BENCHMARK(BM_TagsAndPosesTracked)->Unit(benchmark::kMillisecond);

void BM_BodyPose(benchmark::State& state) {
  const Footage& f = footage();
  auto detector = TagDetector::create({});
  const RigTags tags = {(*detector)->detect(f.frames[0].image, f.rig.cameras[0].model)};
  for (auto _ : state) benchmark::DoNotOptimize(estimate_body_pose(f.rig, f.rig.bow, tags, {}));
}
BENCHMARK(BM_BodyPose)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace gnathion
