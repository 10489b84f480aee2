// Printed against planned: the six procedures of the method, from scans made after printing.
//
// Definitions, regions, frames and signs are in docs/evaluation.md. All poses end in Dental. The scans with
// the splint in place share one frame of their own (SeatedScan), as a scanner exports a bite.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform.h"
#include "evaluation/integrity.h"
#include "evaluation/statistics.h"
#include "occlusion/arch.h"

namespace gnathion {

/// In the order of the method; names as in the published table.
enum class Procedure : std::uint8_t {
  kSplintVsModel,
  kMaxillaVsModel,
  kMandibleVsModel,
  kMaxillaryClearance,
  kMandibularSliding,
  kMandibularTransformation,
};
inline constexpr std::size_t kProcedureCount = 6;
const char* procedure_name(Procedure procedure);   ///< "splint_vs_model", …
const char* procedure_title(Procedure procedure);  ///< "Splint vs. model", …
std::optional<Procedure> procedure_of(const std::string& name);

using SharedMesh = std::shared_ptr<const TriangleMesh>;

/// What was planned, in Dental.
struct PlannedSplint {
  std::string name;                 ///< of the design: its folder's name
  SharedMesh splint;                ///< the design
  SharedMesh maxilla, mandible_mi;  ///< the models that it was designed on
  Motion<Dental> therapeutic;       ///< T_th
};

/// What was scanned after printing. Seated scans share one frame, any frame; absent ones are null.
struct SplintScans {
  SharedMesh splint;       ///< the splint in place (it may show teeth and palate: they are told apart)
  SharedMesh maxilla;      ///< what is seen of the upper jaw with the splint in place
  SharedMesh mandible;     ///< the lower jaw, biting on the splint
  SharedMesh splint_free;  ///< the splint alone, inside and out, in a frame of its own
};

struct EvaluationCase {
  std::string name;  ///< of the splint, in tables
  PlannedSplint planned;
  SplintScans scans;
};

enum class SeatRegion : std::uint8_t { kAuto, kPalate, kCrowns, kWhole };

struct EvaluationOptions {
  SeatRegion seat_region = SeatRegion::kAuto;  ///< what procedure 4 fits
  double reach_mm = 3.0;       ///< beyond it a point belongs to something else and is not measured
  double rim_mm = 0.5;         ///< points within this of a boundary are peripheral
  double steep_deg = 60.0;     ///< normals that differ by more are peripheral
  double noise_mm = 0.05;      ///< of the scans, 1σ: floor of the fits' scale
  std::size_t points = 12000;  ///< of each fit
  std::uint64_t seed = 1;
  bool integrity = true;       ///< check the splint as a body too
  bool refuse_foreign = true;  ///< a scan that fits another design better is refused, else warned of
};

/// Why a point of a scan counts or not.
enum class PointUse : std::uint8_t {
  kCore,       ///< measured, and not peripheral
  kBoundary,   ///< measured; near the scan's or the reference's boundary
  kSteep,      ///< measured; the surfaces face differently there
  kBeyondRim,  ///< measured; its foot is on the reference's boundary and it lies beside the surface
  kFar,        ///< not measured: nothing of the reference within reach
  kForeign,    ///< not measured: belongs to another body (splint in a jaw's scan, jaw in the splint's)
};
inline bool is_measured(PointUse use) {
  return use <= PointUse::kBeyondRim;
}

struct PointStatistics {
  std::size_t n = 0;
  double avg_mm = 0.0, std_mm = 0.0;
};

/// Signed distances of a scan's vertices to a reference: positive on the side of its normals (outside).
struct DistanceField {
  SharedMesh scan;                 ///< in its own frame
  Rigid3 dental_from_scan;         ///< pose at which it was measured
  SharedMesh reference;            ///< Dental
  std::vector<float> distance_mm;  ///< per vertex of `scan`; 0 where not measured
  std::vector<PointUse> use;       ///< per vertex of `scan`
  PointStatistics all, core;       ///< with and without peripheral points
  std::size_t boundary = 0, steep = 0, beyond_rim = 0, far = 0, foreign = 0;
};

/// How a scan was fitted, and to what.
struct FitReport {
  std::string region;  ///< "the whole splint", "palate of the model", …
  double rms_mm = 0.0, held_out_mm = 0.0, condition = 0.0, inlier_fraction = 0.0;
  std::size_t points = 0;
  std::vector<std::string> weak;
  Matrix6 covariance = Matrix6::Zero();
  double scale = 1.0;  ///< of the scan over the model, where it was estimated (printed splint)
};

/// A motion of an arch, told in millimetres on it.
struct MotionFigure {
  Motion<Dental> motion;  ///< from planned to found (procedure 4: from found to planned, the correction)
  Matrix6 covariance = Matrix6::Zero();
  Vector3 centroid_mm = Vector3::Zero();  ///< of the crowns of the arch that moves
  double alpha_deg = 0.0;
  double t_mm = 0.0;          ///< displacement of the centroid
  double max_tooth_mm = 0.0;  ///< largest displacement over the crowns
  std::uint8_t max_tooth_fdi = 0;
  double alpha_sigma_deg = 0.0, t_sigma_mm = 0.0;  ///< 1σ of the estimate
};

struct ProcedureResult {
  Procedure procedure = Procedure::kSplintVsModel;
  DistanceField field;
  std::string fitted_region, measured_region;
  std::optional<FitReport> fit;  ///< the fit that this procedure adds; none: the pose comes from another
  std::optional<MotionFigure> motion;
};

struct SplintEvaluation {
  std::string name;
  PlannedSplint planned;
  SharedMesh mandible_tp;                   ///< T_th · L0
  ArchFrame arch;                           ///< of the planned jaws in MI
  Rigid3 dental_from_seated;                ///< by the splint
  std::vector<ProcedureResult> procedures;  ///< in order; those that the scans allow
  Integrity integrity;
  std::vector<std::string> warnings;

  const ProcedureResult* find(Procedure procedure) const;  ///< null where it was not run
};

/// Runs the procedures that the scans allow. `others` are further designs, asked when the fit is doubtful.
/// Errors (kInput), by name: mirrored or inside-out scan, another splint's scan, undetermined fit.
Result<SplintEvaluation> evaluate_splint(const EvaluationCase& input,
                                         const std::vector<PlannedSplint>& others,
                                         const EvaluationOptions& options, Progress& progress);

/// Tables over splints, in the order of the method; procedures without rows are left out.
std::vector<ProcedureTable> tables_of(const std::vector<SplintEvaluation>& splints,
                                      const StatisticsOptions& options);
/// The same without peripheral points.
std::vector<ProcedureTable> core_tables_of(const std::vector<SplintEvaluation>& splints,
                                           const StatisticsOptions& options);

}  // namespace gnathion
