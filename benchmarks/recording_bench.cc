// Recording and replay of camera images: one 1280x720 frame.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <filesystem>

#include "acquisition/recording.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

fs::path scratch(const char* name) {
  return fs::temp_directory_path() / (std::string("gnathion_bench_") + name + std::to_string(::getpid()));
}

FrameSample camera_frame() {
  return {{"camera_0", 0, {0}, {0}, {0}}, camera_like_image(1280, 720, 1)};
}

void BM_RecordFrame(benchmark::State& state) {
  static const char* const kinds[] = {"", "lz4", "zstd"};
  RecordingOptions options;
  options.compression = kinds[state.range(0)];
  options.reserve_space = false;
  auto writer = RecordingWriter::create("/dev/null", options);
  FrameSample frame = camera_frame();
  for (auto _ : state) {
    ++frame.header.sequence;
    frame.header.arrival.ns += 16'666'667;
    if (!writer->write(frame)) state.SkipWithError("cannot write");
  }
  state.SetBytesProcessed(state.iterations() * 1280 * 720);
  state.SetLabel(*kinds[state.range(0)] ? kinds[state.range(0)] : "none");
}
BENCHMARK(BM_RecordFrame)->DenseRange(0, 2)->Unit(benchmark::kMicrosecond);

void BM_ReplayFrame(benchmark::State& state) {
  const fs::path path = scratch("replay");
  {
    auto writer = RecordingWriter::create(path);
    FrameSample frame = camera_frame();
    for (std::uint32_t i = 0; i < 120; ++i) {
      frame.header.sequence = i;
      frame.header.arrival.ns += 16'666'667;
      if (!writer->write(frame)) state.SkipWithError("cannot write");
    }
    (void)writer->finish();
  }
  auto source = RecordingSource::open(path);
  for (auto _ : state) {
    auto next = (*source)->next();
    if (!*next) {
      (void)(*source)->seek({0});
      next = (*source)->next();
    }
    benchmark::DoNotOptimize(&**next);
  }
  state.SetBytesProcessed(state.iterations() * 1280 * 720);
  fs::remove(path);
}
BENCHMARK(BM_ReplayFrame)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace gnathion
