// The volume readers against arbitrary bytes: a volume whose voxels are all there and whose place is finite, or a
// refusal.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "anatomy/volume/read_volume.h"

namespace {

void require(bool condition, const char* promise) {
  if (condition) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

void check(const gnathion::Result<gnathion::VolumeFile>& read) {
  if (!read) {
    require(!read.error().why.empty(), "a refusal says why");
    return;
  }
  const gnathion::Volume& v = read->volume;
  const std::size_t count = v.grid.count();
  require(count > 0, "an accepted volume has voxels");
  require((v.voxels16.empty() ? v.voxels.size() : v.voxels16.size()) == count, "and all of them");
  require(v.grid.step_mm.allFinite() && v.grid.origin_mm.allFinite(), "its place is finite");
  double sum = 0.0;
  for (std::size_t i = 0; i < count; i += count / 1000 + 1) sum += v.value(i);
  require(sum == sum, "its values are numbers");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  gnathion::ReadVolumeOptions small;
  small.largest_bytes = 16 << 20;
  check(gnathion::parse_dicom(bytes, "fuzz.dcm", small));
  check(gnathion::parse_nifti(bytes, "fuzz.nii", small));
  check(gnathion::parse_nrrd(bytes, "fuzz.nrrd", small));
  return 0;
}
