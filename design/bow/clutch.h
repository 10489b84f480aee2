// The clutch: a shell on the labial surfaces of the lower front teeth. Private to design/bow/.
//
// Bow frame: x left, y posterior, z up. Inside, grids lie in a frame whose z runs along the insertion (from
// the lips to the teeth), so that what teeth hide from there is one sweep.
#pragma once

#include <string>
#include <vector>

#include "core/mesh_query.h"
#include "core/result.h"
#include "design/bow/bow_parameters.h"
#include "design/coarse_grid.h"
#include "occlusion/arch.h"

namespace gnathion {

/// A function of the arc length, in equal steps, constant beyond its ends.
class ArcProfile {
 public:
  ArcProfile() = default;
  ArcProfile(double first_mm, double step_mm, std::vector<double> values);
  double operator()(double s_mm) const;
  /// Lowest (or highest) value within `reach_mm`, then the mean over the same reach: never above (below)
  /// itself.
  ArcProfile lowered(double reach_mm) const;
  ArcProfile raised(double reach_mm) const;
  double first_mm() const { return first_; }
  double step_mm() const { return step_; }
  std::vector<double>& values() { return values_; }
  const std::vector<double>& values() const { return values_; }

 private:
  double first_ = 0, step_ = 0.5;
  std::vector<double> values_;
};

/// The jaws in the bow's frame, ready for the clutch.
struct ClutchScene {
  MeshQuery mandible, maxilla;               ///< closed to solids
  ArchFrame lower;                           ///< the mandible's own curve
  std::vector<std::uint8_t> fdi;             ///< per vertex of `mandible_scan`
  TriangleMesh mandible_scan, maxilla_scan;  ///< as scanned
  std::vector<Rigid3> jaw_positions;         ///< motions of the mandible from MI, MI (identity) first
};

class Clutch {
 public:
  /// Refused (kInput): no lower front teeth.
  static Result<Clutch> build(const ClutchScene& scene, const BowParameters& p);

  /// Distance to the shell without its room for the teeth; large far away.
  double shell_mm(const Vector3& p_bow_mm) const;
  /// What must stay free: teeth with bonding gap, their shadow along the insertion, the maxilla with its
  /// clearance; negative where free. With exact distances for points that lie together.
  double room_estimate_mm(const Vector3& p_bow_mm) const;
  void room_exact_mm(const std::vector<Vector3>& p_bow_mm, std::vector<double>& out) const;
  bool near(const Vector3& p_bow_mm) const {
    return reach_.min_mm.x() <= p_bow_mm.x() && p_bow_mm.x() <= reach_.max_mm.x() &&
           reach_.min_mm.y() <= p_bow_mm.y() && p_bow_mm.y() <= reach_.max_mm.y() &&
           reach_.min_mm.z() <= p_bow_mm.z() && p_bow_mm.z() <= reach_.max_mm.z();
  }

  const Vector3& withdrawal() const { return withdrawal_; }  ///< unit, away from the teeth
  double front_y_mm() const { return front_y_; }             ///< of the labial surface at the stem
  double stem_top_mm() const { return stem_top_; }           ///< highest that a stem may reach, maxilla apart
  double stem_bottom_mm() const { return stem_bottom_; }     ///< where the clutch ends there
  double height_mm() const { return height_; }               ///< mean height of the shell

 private:
  struct Terms;
  Terms terms_at(const Vector3& p_bow_mm) const;
  double room_of(const Terms& t) const;
  void choose_withdrawal(const ClutchScene& scene, const ArchRuler& ruler);
  void sample(const ClutchScene& scene, const Box& teeth);
  void find_margins(const ClutchScene& scene, const ArchRuler& ruler, double low_mm, double high_mm);
  void limit(const ArchRuler& ruler);
  void open_shell();
  void find_stem(const ClutchScene& scene);

  BowParameters par_;
  const MeshQuery* mandible_ = nullptr;
  Vector3 withdrawal_ = -Vector3::UnitY();
  Rigid3 grid_from_bow_;
  Box reach_;
  double s_low_ = 0, s_high_ = 0;
  ArcProfile edge_, top_, bottom_;
  CoarseGrid teeth_, embrasures_, shadow_, outer_, maxilla_, limits_, below_, opened_;
  double front_y_ = 0, stem_top_ = 0, stem_bottom_ = 0, height_ = 0;
};

}  // namespace gnathion
