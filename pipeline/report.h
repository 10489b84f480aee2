// The one-page report of a case.
#pragma once

#include <filesystem>

#include <vector>

#include "core/result.h"

namespace gnathion {

struct CaseResults;
struct StepRecord;

/// report.html in `folder`: what was measured, with what error, the splint's gates and the pictures of
/// pictures/ in any of `made_in` embedded. One self-contained file, marked as research use; it names the case by its
/// id, and what it was made from by `record`.
Status write_report(const CaseResults& results, const std::vector<std::filesystem::path>& made_in,
                    const StepRecord& record, const std::filesystem::path& folder);

}  // namespace gnathion
