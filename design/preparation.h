// The jaws made ready for design: turned into the design frame, closed to solids, with the local occlusal
// level.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh_query.h"
#include "core/result.h"
#include "design/coarse_grid.h"
#include "design/edits.h"
#include "design/flat_plane.h"
#include "design/freedom.h"
#include "design/margin.h"
#include "design/parameters.h"
#include "design/splint.h"
#include "occlusion/teeth.h"

namespace gnathion {

/// Closes an open scan to a solid. Small boundary loops (scan holes) are filled as the surface about them
/// goes on (hole_patch.h), or with least area where that cannot be told; loops wider than `rim_width_mm` (the
/// rim of the scan) are extruded along `away` (unit, from the crowns to the base) and capped flat. `filled`
/// receives one line per hole wider than 1 mm.
TriangleMesh closed_to_solid(const TriangleMesh& mesh, const Vector3& away, std::vector<std::string>* filled,
                             double rim_width_mm = 15.0);

/// Where the splint stands along the arch, as arc lengths (right negative).
struct CoveredArc {
  double right_mm = -1e3, left_mm = 1e3;  ///< outer ends of the outermost covered teeth
  bool right_last = true,
       left_last = true;  ///< those are the arch's last teeth: a distal wall goes round them
  /// The front that stays bare lies between these; none where right_front >= left_front.
  double right_front_mm = 0.0, left_front_mm = 0.0;
};

/// The local occlusal level of an arch: a ruled surface that rests on the crowns from the occlusal side,
/// along the curve of Spee and tilted across the arch with the crowns (curve of Wilson; tipped molars). By
/// position across a.
class OcclusalMap {
 public:
  OcclusalMap() = default;
  /// `support` in the design frame (solid or scan); sampled every 0.5 mm over its box.
  OcclusalMap(const TriangleMesh& support, const ArchFrame& frame, const Rigid3& design_from_dental,
              const CoveredArc& covered);
  /// Height of the level along z.
  double level_mm(const Vector3& p_design_mm) const;
  /// Distance from the arch curve, buccal positive.
  double off_curve_mm(const Vector3& p_design_mm) const;
  /// How far behind the last teeth (negative before them), along the arch; -1e3 at ends that lie elsewhere.
  double behind_teeth_mm(const Vector3& p_design_mm) const;
  /// How far beyond covered teeth that are not the last ones, along the arch: their neighbours stay bare.
  double beyond_cover_mm(const Vector3& p_design_mm) const;

 private:
  double sample(const std::vector<float>& values, const Vector3& p_mm) const;
  Vector3 origin_ = Vector3::Zero();
  double spacing_ = 0.5;
  int nx_ = 0, ny_ = 0;
  std::vector<float> level_, off_, behind_, beyond_;
};

/// The design frame: z along a (towards the gingiva of the support, the arch that wears the splint), y
/// posterior, x = y × z (left over the maxilla, right over the mandible), origin on the occlusal plane.
/// Everything is built in it, so that the result does not depend on how the jaws lie in space.
struct Preparation {
  ArchFrame arch;  ///< in Dental
  Rigid3 design_from_dental;
  Insertion insertion;                   ///< direction in Dental
  Rigid3 tp_from_mi;                     ///< the opposing arch's motion, told in the design frame
  MeshQuery support;                     ///< M, closed, design frame
  MeshQuery opposing;                    ///< in TP (L_TP over a maxillary splint), closed, design frame
  std::optional<MeshQuery> given_stamp;  ///< S_occ in MI where it is given, extruded to a solid, design frame
  std::vector<Vector3> support_normals;  ///< per vertex of M, smoothed over about 0.4 mm
  std::vector<double>
      support_sharpness;  ///< per vertex of M, 0 smooth to 1: convex tips narrower than the grid
  std::vector<double> opposing_sharpness;
  EditField edits;
  std::vector<FreePose> free_poses;  ///< excursions that must run free
  OcclusalMap level;
  GridShape coarse;
  int refinement = 3;  ///< fine voxels per coarse spacing
  std::vector<std::string> warnings;
  std::vector<std::uint8_t> support_fdi;  ///< per vertex of the supporting arch's scan as given; 0: no tooth

  MarginSurface margin = {};                    ///< where the operator drew one
  std::vector<std::string> label_texts = {};    ///< to emboss, the fullest first; empty: no label
  std::optional<FlatPlane> flat = {};           ///< in S_occ's place, for a stabilisation splint
  ToothPartition support_teeth = {};            ///< of the supporting arch
  std::vector<std::uint8_t> opposing_fdi = {};  ///< per vertex of the opposing arch's scan as given

  /// The height at which the splint is cut: depth_mm behind the level, or the drawn margin.
  double cut_mm(const Vector3& p_mm, double depth_mm) const {
    const double plane = level.level_mm(p_mm) + depth_mm;
    return margin.empty() ? plane : margin.cut_mm(p_mm, plane);
  }
  /// The solid whose surface is S_occ, in MI.
  const MeshQuery& stamp_source() const { return given_stamp ? *given_stamp : support; }
};

/// How fine the coarse grids are, and how much room they have.
struct PreparationGrid {
  double spacing_mm = 0.3;  ///< about; a multiple of the voxel
  /// The box is widened to multiples of this, so that it stays the same while a parameter is dragged; 0: no
  /// wider than needed.
  double room_mm = 0.0;
};

/// `known`: name_jaws() of these inputs and corrections, where the caller has it; found here otherwise.
Result<Preparation> prepare(const SplintInputs& inputs, const SplintParameters& parameters,
                            const PreparationGrid& grid = {}, const NamedJaws* known = nullptr);

/// The same jaws once more: with another T_th, other edits, excursions or sizes. What hangs on the supporting
/// arch alone is kept; its insertion's parameters and depth must be those of `last`.
Result<Preparation> prepared_again(Preparation last, const SplintInputs& inputs,
                                   const SplintParameters& parameters, const PreparationGrid& grid = {});

}  // namespace gnathion
