// The temporomandibular joints: condyle and fossa as surfaces, found in a volume or given.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/volume/volume.h"
#include "core/mesh.h"
#include "core/result.h"
#include "core/transform.h"

namespace gnathion {

enum class Side { kLeft, kRight };
inline const char* side_name(Side side) {
  return side == Side::kLeft ? "left" : "right";
}

/// One joint, in the dental frame, the mandible in MI. Triangles face away from the bone; surfaces are open
/// where bone goes on (the condyle's neck, the rim of the fossa).
struct Joint {
  Side side = Side::kLeft;
  TriangleMesh condyle;  ///< moves with the mandible
  TriangleMesh fossa;    ///< with the articular eminence; stays with the maxilla
  Vector3 medial_pole_mm = Vector3::Zero(), lateral_pole_mm = Vector3::Zero();  ///< of the condyle
  Vector3 centre_mm() const { return 0.5 * (medial_pole_mm + lateral_pole_mm); }
};

struct Joints {
  std::optional<Joint> left, right;
  std::string source;  ///< in words: "CBCT scan.nrrd, bone above 431 HU", "meshes"
  /// How far the surfaces themselves may be off (1σ; half a voxel for volumes); nothing: unknown.
  std::optional<double> surface_sigma_mm;
  /// Of the pose of the condyles in MI, against the fossae, and of the fossae's own, independent of it (left
  /// perturbation, Dental). An error that both share is in neither: it moves no distance. Both are 0 where
  /// one volume shows the jaws in MI. Nothing: unknown.
  std::optional<Matrix6> condyle_covariance;
  std::optional<Matrix6> fossa_covariance;
  /// Where the mandible was is only assumed (no lower teeth in the volume): distances carry no sigma.
  bool mi_assumed = false;
  /// Of the mandible from MI to where it was when the volume was taken; identity: in MI.
  Motion<Dental> scanned_from_mi;
  std::vector<std::string> warnings;
  bool empty() const { return !left && !right; }
};

/// Where one joint is looked for, in the volume's frame. Seeds are points in or near the bone that is meant.
struct JointRegion {
  Box box_mm;
  std::optional<Vector3> condyle_seed_mm, fossa_seed_mm;
};

/// A joint as cut out of a volume, in the volume's frame.
struct JointSurfaces {
  TriangleMesh condyle, fossa;
  /// They hung together at the threshold and were parted in the middle between two denser cores: where they
  /// come close, the distance is known to a voxel only.
  bool bridged = false;
};

/// Bone of one joint above `threshold`. Within the box, the condyle is the bone that leaves it below and not
/// above, the fossa the bone that leaves it above; seeds override. Marrow spaces are filled, so that only
/// outer surfaces remain. Errors (kInput): the box is outside the volume or cut by it, no bone, condyle and
/// fossa are one piece at this threshold.
Result<JointSurfaces> find_joint(const Volume& volume, double threshold, const JointRegion& region,
                                 const std::string& name);
/// The top of the condyle's head: the highest bone of the mandible in the box within `across_mm` of where the
/// head is expected. Nothing where the bones cannot be told apart.
std::optional<Vector3> condyle_top(const Volume& volume, double threshold, const Box& search_mm,
                                   const Vector3& expected_mm, double across_mm);
/// From a label map: the outlines of all voxels with one of the labels, within the box if it is given.
Result<TriangleMesh> surface_of_labels(const Volume& labels, const std::vector<int>& which,
                                       const std::optional<Box>& box_mm, const std::string& name);

/// Extremes of the condylar head (its upper 8 mm) along its long axis across the jaw. `up` and `left` are
/// unit.
struct CondylarPoles {
  Vector3 medial_mm = Vector3::Zero(), lateral_mm = Vector3::Zero();
};
CondylarPoles condylar_poles(const TriangleMesh& condyle, Side side, const Vector3& up, const Vector3& left);

/// condyle_left.stl, fossa_left.stl, condyle_right.stl, fossa_right.stl (or .ply, .obj) in the dental frame;
/// one side suffices. joints.json beside them, as `gnathion cbct joints` writes it, adds what is known of
/// their accuracy. `up` and `left` as above.
Result<Joints> read_joint_meshes(const std::filesystem::path& folder, const Vector3& up, const Vector3& left);
bool holds_joint_meshes(const std::filesystem::path& folder);

}  // namespace gnathion
