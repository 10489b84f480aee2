#include "pipeline/build_id.h"

#include "pipeline/provenance.h"

namespace gnathion {

const std::string& build_id() {
  static const std::string id = sha256_of("/proc/self/exe").value_or("unknown").substr(0, 16);
  return id;
}

}  // namespace gnathion
