// The splint that goes out by OpenIGTLink.
#pragma once

#include <memory>
#include <string>

#include "core/mesh.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

/// results/splint.stl of the case, or the newest */splint.stl of its designs; null when there is none.
std::shared_ptr<const TriangleMesh> newest_splint(const CaseRoot& root, const std::string& case_id);

}  // namespace gnathion::daemon
