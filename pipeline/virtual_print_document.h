// What the report of a virtual print says, in order.
#pragma once

#include "evaluation/virtual_print.h"
#include "pipeline/evaluation_pictures.h"
#include "pipeline/evaluation_report.h"
#include "pipeline/report_document.h"

namespace gnathion {

/// Figures of all designs side by side, then those of each.
std::vector<EvaluationFigure> virtual_print_figures(const std::vector<VirtualPrint>& prints,
                                                    const VirtualPrintOptions& options);

ReportDocument virtual_print_document(const std::vector<VirtualPrint>& prints,
                                      const VirtualPrintOptions& options,
                                      const std::vector<ReportInput>& inputs,
                                      const std::vector<EvaluationFigure>& figures,
                                      const std::string& date_iso);

}  // namespace gnathion
