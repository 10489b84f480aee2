// What the six procedures would find before anyone prints: Monte Carlo over printing, seating and scanning,
// from the design alone. Models and the sources of their magnitudes: docs/virtual-print.md.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/progress.h"
#include "core/result.h"
#include "evaluation/evaluation.h"

namespace gnathion {

/// Magnitudes are one standard deviation over prints, patients and scans unless said otherwise.
struct PrintErrorModel {
  double scale_sigma = 0.0015;        ///< relative, each axis of the arch by itself
  double common_scale_sigma = 0.001;  ///< relative, all axes together
  double growth_sigma_mm = 0.03;      ///< cured beyond the outline: offset along normals
  double blur_mm = 0.08;              ///< (not random) radius over which light and resin round off edges
  double warp_sigma_mm = 0.10;        ///< at the arch's ends: lift, spread and twist, each
  double roughness_mm = 0.02;         ///< along normals, uncorrelated
  double waviness_mm = 0.06;          ///< along normals, correlated over waviness_length_mm
  double waviness_length_mm = 8.0;
};
struct SeatingModel {
  /// Of the splint on the maxilla, along each axis of the arch; upwards teeth are in the way, so that this
  /// part only ever leaves the splint away from the maxilla.
  double shift_sigma_mm = 0.12;
  double turn_sigma_deg = 0.18;  ///< about each axis
  double slide_sigma_mm = 0.13;  ///< of the mandible on the splint, each way in the occlusal plane
  double bite_sigma_mm = 0.06;   ///< across it, away from the splint
  double slide_turn_sigma_deg = 0.18;
};
struct ScanErrorModel {
  double noise_mm = 0.015;    ///< along normals, uncorrelated
  double waviness_mm = 0.03;  ///< correlated over waviness_length_mm
  double waviness_length_mm = 12.0;
  double scale_sigma = 0.0008;    ///< relative
  double stitch_sigma_mm = 0.06;  ///< at the arch's ends, as frames are joined: lift, spread and twist, each
};
struct VirtualPrintOptions {
  PrintErrorModel print;
  SeatingModel seating;
  ScanErrorModel scan;
  std::size_t trials = 8;  ///< splints printed of each design
  std::uint64_t seed = 1;
  EvaluationOptions evaluation;
  StatisticsOptions statistics;
};

/// Names, values and units of all magnitudes, for reports: "print.blur_mm", 0.08.
std::vector<std::pair<std::string, double*>> magnitudes(VirtualPrintOptions& options);
/// Sets one by name; refused (kUsage) with the names that there are.
Status set_magnitude(VirtualPrintOptions& options, const std::string& name_equals_value);
/// Refused (kUsage): negative or absurd magnitudes, no trials.
Status check_options(const VirtualPrintOptions& options);

class PlannedModel;

/// The design made ready, and what is found on it once for all trials.
struct VirtualPatient {
  std::shared_ptr<const PlannedModel> model;
  std::vector<std::uint8_t> cavity;     ///< per vertex of the splint: faces the maxilla
  std::vector<std::uint8_t> contact;    ///< per vertex of the splint: the mandible in TP bites there
  std::vector<std::uint8_t> uncovered;  ///< per vertex of the maxilla: seen with the splint in place
};
Result<VirtualPatient> prepare_patient(const PlannedSplint& planned, const EvaluationOptions& options);

/// What one trial drew: the truth to judge the procedures by. Motions in Dental.
struct VirtualTrial {
  EvaluationCase scanned;
  Rigid3 seating;   ///< random part: of the splint on the maxilla, from where its cavity fits best
  Rigid3 sliding;   ///< random part: of the mandible on the splint, from where its contacts fit best
  Rigid3 mandible;  ///< whole: of the mandible relative to the maxilla, from TP to where it came
};
/// One print, put in, bitten on and scanned. Deterministic for a seed and trial.
VirtualTrial virtual_trial(const VirtualPatient& patient, const VirtualPrintOptions& options,
                           std::size_t trial);

/// Over trials: mean, and 5 and 95 % quantiles (the middle nine tenths).
struct PredictedFigure {
  double mean = 0.0, low = 0.0, high = 0.0;
};
struct PredictedProcedure {
  ProcedureTable table;  ///< a row for each trial
  PredictedFigure avg_mm, std_mm;
  std::optional<PredictedFigure> alpha_deg, t_mm, max_tooth_mm;
};
struct VirtualPrint {
  std::string design;
  std::vector<PredictedProcedure> procedures;  ///< in the order of the method
  std::vector<PredictedProcedure> core;        ///< the same without peripheral points
  std::vector<std::string> refused;            ///< trials that the procedures refused, and why
  std::vector<std::string> warnings;
};
/// All trials of one design. The same result on any number of threads.
Result<VirtualPrint> virtual_print(const PlannedSplint& planned, const VirtualPrintOptions& options,
                                   Progress& progress);

}  // namespace gnathion
