// The figures of an evaluation: distance maps, histograms, profiles, error bars, radar.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/result.h"
#include "evaluation/evaluation.h"
#include "rendering/drawing.h"

namespace gnathion {

struct EvaluationFigure {
  std::string file;     ///< name without extension, unique in the evaluation: "map_3_splint_vs_model"
  std::string caption;  ///< says what it shows without the picture
  std::shared_ptr<const Drawing> drawing;
  bool is_map = false;  ///< holds a rendered view: kept as PNG beside the report, not as SVG
};

/// The colours' range for all maps of a report, so that they can be compared: about 2.5 of the median STD,
/// round. Larger distances take the end colours.
double map_range_mm(const std::vector<SplintEvaluation>& splints);

/// Error bars over splints and radar over procedures; empty without tables.
std::vector<EvaluationFigure> overview_figures(const std::vector<ProcedureTable>& tables);

/// One map for each procedure: the splint from outside and into its cavity, the jaws from their occlusal
/// side.
Result<std::vector<EvaluationFigure>> distance_maps(const SplintEvaluation& splint, double range_mm);
/// One histogram for each procedure, over its own range, coloured as the maps.
std::vector<EvaluationFigure> distance_histograms(const SplintEvaluation& splint, double color_range_mm);
/// Cross-sections at the planes of the splint's integrity figures, planned beside printed, in the method's
/// colours.
std::vector<EvaluationFigure> profile_figures(const SplintEvaluation& splint);

/// A name as part of a file's name: letters, digits, - and _ stay.
std::string file_part(const std::string& name);

}  // namespace gnathion
