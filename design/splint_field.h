// The splint as one implicit function: negative in the material, and near its zero level a distance in mm.
//
// What lies on teeth is taken from the meshes themselves (closest points); what is smooth or hidden comes
// from coarse grids. All in the design frame.
#pragma once

#include "design/coarse_grid.h"
#include "design/imprint_limit.h"
#include "design/label.h"
#include "design/preparation.h"

namespace gnathion {

/// Which part of the construction shapes the surface at a point.
enum class SurfacePart : std::uint8_t { kCavity, kOuter, kStamp, kImprint, kRelief, kAperture, kRim };

/// Signed quantities at a point, mm.
struct FieldTerms {
  double body = 0.0;           ///< shell with stamp
  double cavity = 0.0;         ///< C, distance from the cavity
  double cut = 0.0;            ///< K, distance from what the opposing arch takes away
  double rim = 0.0;            ///< height over the cutting surface
  double value = 0.0;          ///< the splint
  bool body_by_stamp = false;  ///< the exact stamp may shape the body here
  SurfacePart part = SurfacePart::kOuter;
};

/// Coarse distances that hang on the jaws and T_th alone, not on any size of the splint.
struct JawDistances {
  CoarseGrid support;         ///< φ_M
  CoarseGrid support_swept;   ///< M ⊕ R_a
  CoarseGrid swept_from;      ///< z at which the sweep's value was found: where M bulges most, seen along a
  CoarseGrid stamp;           ///< φ of T_th M
  CoarseGrid opposing;        ///< φ of L_TP
  CoarseGrid opposing_swept;  ///< L_TP and its way down, but for the last kSweepStart
};
JawDistances sampled_jaws(const Preparation& preparation);
/// The same after the opposing arch has moved: the support's are those of `last`, whose box is the same.
JawDistances resampled_opposing(const Preparation& preparation, JawDistances last);

class SplintField {
 public:
  /// Refers to both.
  SplintField(const Preparation& preparation, const SplintParameters& parameters)
      : SplintField(preparation, parameters, sampled_jaws(preparation)) {}
  SplintField(const Preparation& preparation, const SplintParameters& parameters, JawDistances jaws);

  /// From grids alone; good to about 0.1 mm.
  FieldTerms estimate(const Vector3& p_mm) const;
  /// The value of estimate() at the nodes of a coarse cell's finer grid, k a side, from the cell's low node
  /// on (z fastest). Values beyond ± kSureMm may be any on their side of that.
  void estimate_cell(const Eigen::Vector3i& cell, int k, float* values) const;
  static constexpr double kSureMm = 0.2;
  /// With mesh distances for every term that matters; for points close together (values only).
  void exact(const std::vector<Vector3>& points_mm, std::vector<double>& values) const;

  /// False where neither jaw can be within distance_mm; cheap.
  bool near_jaw(const Vector3& p_mm, double distance_mm) const;

  const Preparation& preparation() const { return prep_; }
  const SplintParameters& parameters() const { return par_; }
  const CoarseGrid& body_grid() const { return body_; }
  const JawDistances& jaws() const { return jaws_; }
  /// Where the label was put; nothing where none was asked for or none has room.
  const std::optional<Label>& label() const { return label_; }

 private:
  struct Ingredients;
  void build_shapes();
  void place_label();
  struct Questions;
  Ingredients interpolated(const Vector3& p_mm) const;
  Ingredients interpolated(const Vector3& p_mm, const GridCell& cell) const;
  bool all_outside(const GridCell& cell) const;
  double cavity(const Ingredients& in) const;
  double cut(const Vector3& p_mm, const Ingredients& in) const;
  double stamp(const Vector3& p_mm, const Ingredients& in) const;
  double body(const Vector3& p_mm, const Ingredients& in, double cavity_mm, double stamp_mm) const;
  double rim(const Vector3& p_mm) const;
  double film(double cavity_mm, double cut_mm) const;
  bool by_stamp(const Ingredients& in, double stamp_mm) const;
  FieldTerms compose(const Vector3& p_mm, const Ingredients& in) const;
  void ask(const Vector3& p_mm, const Ingredients& in, std::size_t i, Questions& questions) const;
  void ask_passed(const Vector3& p_mm, const Ingredients& in, std::size_t i, Questions& questions) const;
  void answer(Questions& questions, std::vector<Ingredients>& in) const;
  double seat_gap_mm(const ClosestPoint& closest) const;

  const Preparation& prep_;
  const SplintParameters& par_;
  Rigid3 natural_from_tp_;  ///< T_th⁻¹
  JawDistances jaws_;
  CoarseGrid cavity_closed_;  ///< cavity with embrasures closed
  CoarseGrid body_;           ///< shell, stamp and fillets, smooth
  CoarseGrid body_smoothed_;  ///< the same, blurred: where strokes smooth; else empty
  CoarseGrid free_;           ///< the opposing arch swept along its excursions; empty: none
  std::optional<Label> label_;
  ImprintLimit limit_;  ///< how low the body may stand beside the imprint
};

/// The field's zero level, pieces and all.
TriangleMesh extracted_splint(const SplintField& field);

}  // namespace gnathion
