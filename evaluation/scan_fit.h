// A scan fitted to a model: without a guess or with one, robustly, with what it does not know.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "evaluation/evaluation.h"

namespace gnathion {

struct ScanFitOptions {
  std::optional<Rigid3> guess;       ///< within about 3 mm and 5°; none: search
  std::vector<bool> scan_vertices;   ///< that take part; empty = all
  std::vector<bool> model_vertices;  ///< that take part; empty = all
  /// The scan's size against the model is estimated too and set apart about the model's centroid: a print a
  /// little too large then shifts nothing.
  bool with_scale = false;
  double overlap = 0.5;  ///< expected fraction of the scan that shows the model
  double noise_mm = 0.05;
  std::size_t points = 12000;
  std::uint64_t seed = 1;
  std::string name, region;
};

struct ScanFit {
  Rigid3 model_from_scan;
  FitReport report;
};

/// Errors (kInput): "undetermined", with why.
Result<ScanFit> fit_scan(const TriangleMesh& scan, const TriangleMesh& model, const MeshQuery& model_query,
                         const ScanFitOptions& options);

/// Mean |distance| (mm, each at most `cap_mm`) of some of the scan's points to a model.
double mean_distance_mm(const TriangleMesh& scan, const MeshQuery& model, const Rigid3& model_from_scan,
                        double cap_mm);

}  // namespace gnathion
