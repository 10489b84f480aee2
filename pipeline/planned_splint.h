// A design's folder read back: what was planned.
#pragma once

#include <vector>

#include "core/result.h"
#include "pipeline/evaluate_job.h"

namespace gnathion {

struct PlannedFiles {
  PlannedSplint planned;
  std::vector<EvaluationInput> inputs;  ///< splint, maxilla, mandible, transform
  std::vector<std::string> warnings;    ///< a model that is not what design.json was made from
};

/// Reads design.json and splint.stl of `files.design`, and the models: those that `files` names, else those
/// that design.json names (as given, or relative to the folder or the one above it). Errors (kInput): no
/// design, a rejected one, files that are missing; a model that design.json names but whose content has
/// changed since.
Result<PlannedFiles> read_planned_splint(const EvaluateSplint& files);

}  // namespace gnathion
