// What the six procedures would find before anyone prints: Monte Carlo over printing, seating and scanning,
// from the design alone. Models and the sources of their magnitudes: docs/virtual-print.md.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/random.h"
#include "core/result.h"
#include "evaluation/evaluation.h"

namespace gnathion {

/// Magnitudes are one standard deviation over prints, patients and scans unless said otherwise.
struct PrintErrorModel {
  double scale_sigma = 0.002;         ///< relative, each print axis by itself
  double common_scale_sigma = 0.001;  ///< relative, all axes together
  double growth_sigma_mm = 0.02;      ///< cured beyond the outline: offset along normals
  double blur_mm = 0.08;              ///< (mean) radius over which light and resin round off edges
  double warp_sigma_mm = 0.06;        ///< ends of the arch lift or spread, and twist
  double roughness_mm = 0.02;         ///< along normals, uncorrelated
  double waviness_mm = 0.03;          ///< along normals, correlated over waviness_length_mm
  double waviness_length_mm = 8.0;
};
struct SeatingModel {
  double shift_sigma_mm = 0.08;  ///< along each axis of the arch, of the splint on the maxilla
  double turn_sigma_deg = 0.15;  ///< about each axis
  double slide_sigma_mm = 0.12;  ///< of the mandible on the splint, in the occlusal plane
  double bite_sigma_mm = 0.04;   ///< across it
  double slide_turn_sigma_deg = 0.15;
};
struct ScanErrorModel {
  double noise_mm = 0.015;    ///< along normals, uncorrelated
  double waviness_mm = 0.03;  ///< correlated over waviness_length_mm
  double waviness_length_mm = 12.0;
  double scale_sigma = 0.0008;    ///< relative
  double stitch_sigma_mm = 0.05;  ///< the arch bends as frames are joined: spread at the molars
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

/// What was drawn for one trial: truth to judge the procedures by.
struct VirtualTrial {
  EvaluationCase scanned;
  Motion<Dental> seated;  ///< of the splint on the maxilla, from planned to found: print and seating
  Motion<Dental> slid;    ///< of the mandible on the splint, from TP to found, seen from the splint
};

/// One print of a design, put in, bitten on and scanned. Deterministic for a seed and trial.
Result<VirtualTrial> virtual_trial(const PlannedSplint& planned, const ArchFrame& arch,
                                   const VirtualPrintOptions& options, std::size_t trial);

/// One procedure over all trials of a design.
struct PredictedFigure {
  double mean = 0.0, low95 = 0.0, high95 = 0.0;  ///< over trials: mean, 2.5 and 97.5 % quantiles
};
struct PredictedProcedure {
  Procedure procedure = Procedure::kSplintVsModel;
  ProcedureTable table;  ///< a row for each trial
  PredictedFigure avg_mm, std_mm;
  std::optional<PredictedFigure> alpha_deg, t_mm, max_tooth_mm;
};
struct VirtualPrint {
  std::string design;
  std::vector<PredictedProcedure> procedures;
  std::vector<std::string> refused;  ///< trials that the procedures refused, and why
  std::vector<std::string> warnings;
};

/// All trials of one design. The same result on any number of threads.
Result<VirtualPrint> virtual_print(const PlannedSplint& planned, const VirtualPrintOptions& options,
                                   Progress& progress);

}  // namespace gnathion
