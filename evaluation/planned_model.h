// A planned splint made ready for questions: jaws in order, teeth named, search structures built. Made once,
// asked by every evaluation of that design.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/mesh_query.h"
#include "evaluation/evaluation.h"
#include "evaluation/surface_distance.h"
#include "occlusion/arch.h"

namespace gnathion {

/// A surface with both kinds of search over it.
struct SearchableSurface {
  SharedMesh mesh;
  MeshQuery query;           ///< for fits
  SurfaceDistance distance;  ///< for whole scans
  SearchableSurface(SharedMesh m, double rim_mm)
      : mesh(std::move(m)), query(*mesh), distance(*mesh, rim_mm) {}
};

/// Crowns of an arch, for telling motions in millimetres.
struct Crowns {
  std::vector<Vector3> points_mm;
  std::vector<std::uint8_t> fdi;          ///< of each point
  Vector3 centroid_mm = Vector3::Zero();  ///< of their surface
};

/// What a motion of the arch does to it.
MotionFigure figure_of(const Motion<Dental>& motion, const Matrix6& covariance, const Crowns& crowns);

class PlannedModel {
 public:
  /// Errors (kInput): jaws whose arch cannot be found, jaws or splint missing.
  static Result<std::shared_ptr<const PlannedModel>> make(const PlannedSplint& planned,
                                                          const EvaluationOptions& options);

  const PlannedSplint& planned() const { return planned_; }
  const ArchFrame& arch() const { return arch_; }
  const SharedMesh& mandible_tp() const { return mandible_tp_; }
  const std::vector<std::uint8_t>& maxilla_fdi() const { return maxilla_fdi_; }
  const std::vector<std::uint8_t>& mandible_fdi() const { return mandible_fdi_; }
  const Crowns& maxilla_crowns() const { return maxilla_crowns_; }          ///< Dental
  const Crowns& mandible_tp_crowns() const { return mandible_tp_crowns_; }  ///< Dental, mandible in TP
  /// Vertices of the maxilla inside the arch, beyond the crowns.
  const std::vector<bool>& palate() const { return palate_; }

  const SearchableSurface& splint() const { return *splint_; }
  const SearchableSurface& maxilla() const { return *maxilla_; }
  /// In TP. (In MI it is the same surface, moved: motions are taken into the scan's pose.)
  const SearchableSurface& mandible() const { return *mandible_; }

 private:
  PlannedSplint planned_;
  ArchFrame arch_;
  SharedMesh mandible_tp_;
  std::vector<std::uint8_t> maxilla_fdi_, mandible_fdi_;
  Crowns maxilla_crowns_, mandible_tp_crowns_;
  std::vector<bool> palate_;
  std::unique_ptr<SearchableSurface> splint_, maxilla_, mandible_;
};

/// evaluate_splint for a design that is ready already (`input.planned` is not looked at).
Result<SplintEvaluation> evaluate_splint(const PlannedModel& model, const EvaluationCase& input,
                                         const std::vector<PlannedSplint>& others,
                                         const EvaluationOptions& options, Progress& progress);

/// Collisions, gaps and walls of the splint, planned and as it was found (evaluation/integrity.h).
Integrity check_integrity(const PlannedModel& model, const SplintEvaluation& found, const SplintScans& scans);

}  // namespace gnathion
