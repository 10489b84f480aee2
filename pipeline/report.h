// The one-page report of a case.
#pragma once

#include <filesystem>

#include "core/result.h"

namespace gnathion {

struct CaseResults;

/// report.html in `folder`: what was measured, with what error, the splint's gates and the pictures of
/// folder/pictures embedded. One self-contained file, marked as research use.
Status write_report(const CaseResults& results, const std::filesystem::path& folder);

}  // namespace gnathion
