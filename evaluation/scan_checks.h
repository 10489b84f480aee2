// Is this scan what it is said to be: not mirrored, not inside out, of this design, of both sides.
#pragma once

#include <string>
#include <vector>

#include "evaluation/planned_model.h"
#include "evaluation/scan_fit.h"

namespace gnathion {

/// fit_scan without a guess; a scan that fits badly is tried mirrored and inside out too, and refused by name
/// when that fits clearly better.
Result<ScanFit> fit_checked(const TriangleMesh& scan, const SearchableSurface& model,
                            const ScanFitOptions& options);

/// Refuses (or warns of, by the options) the scan of a splint that fits another design better, and warns of
/// one that fits none well. `fit` may be an error: then the others are asked all the same.
Status belongs_to_this_design(const TriangleMesh& scan, const PlannedModel& model, const Result<ScanFit>& fit,
                              const std::vector<PlannedSplint>& others, const EvaluationOptions& options,
                              const std::string& splint, std::vector<std::string>* warnings);

/// Warns of half an arch: one side of the model is scanned, the other is not. Refuses a scan that shows
/// hardly any of the model.
Status covers_both_sides(const TriangleMesh& scan, const Rigid3& dental_from_scan, const PlannedModel& model,
                         const char* what, const SearchableSurface& surface, const std::string& splint,
                         std::vector<std::string>* warnings);

}  // namespace gnathion
