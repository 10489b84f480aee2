// How a pair of jaws lies in space: occlusal plane, midline direction, arch curve. Found from the shapes
// alone, whatever the axes of the scan.
#pragma once

#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

enum class Arch { kMaxilla, kMandible };

/// The dental arch's own directions, all told in the frame of the meshes (Dental); unit vectors,
/// left × (−anterior) = up.
struct ArchFrame {
  Vector3 origin_mm = Vector3::Zero();   ///< centroid of the arch curve, on the occlusal plane
  Vector3 up = Vector3::UnitZ();         ///< normal of the occlusal plane, from mandible to maxilla
  Vector3 anterior = -Vector3::UnitY();  ///< in the occlusal plane, out of the closed side of the horseshoe
  Vector3 left = Vector3::UnitX();       ///< the patient's left
  Vector3 incisal_mm = Vector3::Zero();  ///< most anterior point of the curve at the midline
  std::vector<Vector3> curve_mm;  ///< arch curve in the occlusal plane, right end to left end, 0.5 mm steps
  Rigid3 arch_from_dental;        ///< to x left, y posterior, z up, origin at origin_mm

  Vector3 to_arch(const Vector3& p_mm) const { return arch_from_dental * p_mm; }
  Rigid3 dental_from_arch() const { return arch_from_dental.inverse(); }
  /// Height over the occlusal plane, mm.
  double height_mm(const Vector3& p_mm) const { return up.dot(p_mm - origin_mm); }
  /// Direction from the occlusal plane towards the gingiva of that arch.
  Vector3 gingival(Arch arch) const { return arch == Arch::kMaxilla ? up : Vector3(-up); }
};

/// Finds the frame of two arches in MI, given in one frame. Sampling is deterministic, and the result
/// turns with the meshes. Refused with kInput, by name: jaws in different frames (nothing of one within
/// 3 mm of the other), a mesh with flipped normals, upper given as lower (where it can be told: the
/// arch of the "mandible" overlaps that of the "maxilla" on the outside), no horseshoe.
Result<ArchFrame> find_arch(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi);

/// The same directions with the arch curve (and incisal point) of one jaw alone: teeth are measured along
/// it. The common curve is kept where the jaw's own cannot be drawn.
ArchFrame frame_of_jaw(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which);

/// Arc-length coordinates along the arch curve of points given in Dental.
struct ArchCoordinates {
  double s_mm =
      0.0;  ///< arc length from the midline, patient's left positive; beyond the ends along the tangent
  double buccal_mm = 0.0;  ///< distance from the curve in the occlusal plane, outwards positive
  double height_mm = 0.0;  ///< over the occlusal plane, up positive
};

/// Projects onto the arch curve; immutable and thread-safe.
class ArchRuler {
 public:
  explicit ArchRuler(const ArchFrame& frame);
  ArchCoordinates measure(const Vector3& p_mm) const;
  double s_min_mm() const { return s_.front(); }
  double s_max_mm() const { return s_.back(); }
  /// Point of the curve at s, in Dental.
  Vector3 at(double s_mm) const;
  /// Unit tangent (towards the patient's left) and outward normal at s, in Dental.
  Vector3 tangent(double s_mm) const;
  Vector3 outward(double s_mm) const;

 private:
  ArchFrame frame_;
  std::vector<Eigen::Vector2d> points_;  ///< (left, posterior)
  std::vector<double> s_;                ///< arc length of each point from the midline
  /// Segments that follow each other, in a circle: what is farther off need not be asked.
  struct Stretch {
    std::size_t first = 0, end = 0;
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    double radius_mm = 0.0;
  };
  std::vector<Stretch> stretches_;
};

}  // namespace gnathion
