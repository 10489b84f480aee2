// The files of an evaluation.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "pipeline/evaluate_job.h"

namespace gnathion {

/// evaluation.json: exactly the keys of the contract (docs/evaluation.md).
nlohmann::json evaluation_json(const std::vector<ProcedureTable>& tables,
                               const std::vector<std::string>& notes);

/// evaluation_details.json: everything else that is known about the figures.
nlohmann::json evaluation_details_json(const EvaluationOutcome& outcome);

}  // namespace gnathion
