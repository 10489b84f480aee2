// The recording reader against arbitrary bytes.
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "acquisition/recording.h"
#include "core/file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("gnathion_fuzz_" + std::to_string(::getpid()) + ".mcap");
  static const struct Cleanup {
    ~Cleanup() { std::filesystem::remove(path); }
  } cleanup;
  if (!gnathion::write_file(path, std::string_view(reinterpret_cast<const char*>(data), size))) return 0;
  (void)gnathion::summarise_recording(path);
  auto source = gnathion::RecordingSource::open(path);
  while (source) {
    const auto next = (*source)->next();
    if (!next || !*next) break;
  }
  return 0;
}
