// 3MF files through lib3mf.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

/// One mesh, unit millimetre. Metadata names are put under the prefix "gnathion:" (3MF core wants own names
/// in a namespace). Whole or not at all; deterministic bytes are lib3mf's zip with a fixed time stamp.
Status write_3mf(const std::filesystem::path& path, const TriangleMesh& mesh,
                 const std::vector<std::pair<std::string, std::string>>& metadata);

}  // namespace gnathion
