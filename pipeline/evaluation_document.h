// What the report of an evaluation says, in order.
#pragma once

#include <string>
#include <vector>

#include "pipeline/evaluation_pictures.h"
#include "pipeline/evaluation_report.h"
#include "pipeline/report_document.h"

namespace gnathion {

struct SplintFigures {
  std::vector<EvaluationFigure> maps, histograms, profiles;
};
struct EvaluationFigures {
  std::vector<EvaluationFigure> overview;
  std::vector<SplintFigures> splints;  ///< in the report's order
};

/// `view_html`: the 3D view, or empty.
ReportDocument evaluation_document(const EvaluationReport& report, const EvaluationFigures& figures,
                                   const std::string& view_html);

}  // namespace gnathion
