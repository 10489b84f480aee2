// What exported scans refer to, and deviations in PLY files: names must never lead out of the scan's folder.
#include <cstdint>
#include <string>

#include "acquisition/scanner/scan_files.h"
#include "acquisition/scanner/scan_ply.h"
#include "core/check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace gnathion;
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  for (const char* name : {"scan.obj", "scan.mtl", "scan.ply"})
    for (const std::string& reference : referred_files(name, bytes)) {
      const std::string local = local_name(reference);
      GNATHION_CHECK(local.empty() || local.front() != '/');
      GNATHION_CHECK(("/" + local + "/").find("/../") == std::string::npos);
      GNATHION_CHECK(local.size() <= reference.size());
    }
  if (const auto deviations = scan_ply_deviation(bytes, "scan.ply"))
    GNATHION_CHECK(deviations->size() * sizeof(float) <= size);
  return 0;
}
