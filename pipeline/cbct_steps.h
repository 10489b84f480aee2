// A volume of the patient in the dental frame: registration by the crowns, and the joints.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/joints/joints.h"
#include "anatomy/volume/read_volume.h"
#include "core/cbct_frame.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform.h"
#include "occlusion/arch.h"
#include "registration/align.h"

namespace gnathion {

/// One surface of the patient found in a volume.
struct CbctRegistration {
  Alignment fit;       ///< target_from_source is the pose, its covariance and the rest
  double level = 0.0;  ///< of the surface in the volume that was aligned
};

struct CbctOptions {
  ReadVolumeOptions read;
  std::optional<double> bone_level, crown_level, skin_level;  ///< nothing: by Otsu
  std::optional<JointRegion> left, right;  ///< nothing: about where the arch says condyles are
  std::optional<Transform<Cbct, Dental>> cbct_from_dental;  ///< a registration made before
  std::optional<Matrix6> covariance;                        ///< its covariance
  /// A label map in the volume's frame, and the labels of mandible (condyles) and skull (fossae). What has no
  /// label is found by threshold.
  std::filesystem::path labels;
  std::vector<int> condyle_labels, fossa_labels;
};

/// Which vertices of an arch are crowns.
std::vector<bool> crown_mask(const TriangleMesh& arch, const ArchFrame& frame, Arch which);
/// cbct_from_dental by the crowns of an arch (dental frame). `crowns` marks their vertices; empty: all of the
/// arch takes part, and the crowns must be a third of it. `guess` within about 3 mm and 5°; none: searched
/// everywhere. Refused (kInput) when not convincing: too few crowns found, residuals beyond half a voxel.
Result<CbctRegistration> register_crowns(const Volume& volume, const TriangleMesh& arch,
                                         const std::vector<bool>& crowns, const CbctOptions& options,
                                         const std::optional<Rigid3>& guess, const std::string& name);
/// The face scan over the skin surface: cbct_from_face.
Result<CbctRegistration> register_face(const Volume& volume, const TriangleMesh& face_scan,
                                       const CbctOptions& options);

/// A volume beside its pose, for X-rays and joints.
struct RegisteredVolume {
  VolumeFile file;
  Transform<Cbct, Dental> cbct_from_dental;
  std::optional<Matrix6> covariance;
};
Result<RegisteredVolume> registered_volume(const std::filesystem::path& path, const TriangleMesh& maxilla,
                                           const TriangleMesh& mandible_mi, const CbctOptions& options,
                                           Progress& progress);

/// The joints in the dental frame, the mandible in MI, or the plain reason why not. `path`: a folder with
/// condyle_left.stl and so on in the dental frame; or a DICOM folder, a NIfTI or NRRD file, which is
/// registered by the crowns. Where the lower teeth in the volume are not in MI, they bring the condyles
/// there.
Result<Joints> joints_from_cbct(const std::filesystem::path& path, const TriangleMesh& maxilla,
                                const TriangleMesh& mandible_mi, const CbctOptions& options,
                                Progress& progress);
/// The same from a volume that is already in memory.
Result<Joints> joints_in_volume(const RegisteredVolume& registered, const TriangleMesh& maxilla,
                                const TriangleMesh& mandible_mi, const CbctOptions& options,
                                Progress& progress);

/// condyle_left.stl, fossa_left.stl, … and joints.json into a folder that exists; joints_from_cbct() reads
/// them.
Status write_joints(const Joints& joints, const std::filesystem::path& folder);
nlohmann::json joints_json(const Joints& joints);

/// {"kind":"pose","to":"cbct","from":from,"unit":"mm","matrix","covariance","rms_mm","held_out_mm","condition",
/// "weak",…}: `transform = "cbct_from_dental.json"` of a [[frame]] in case.toml takes it as it is.
nlohmann::json cbct_registration_json(const CbctRegistration& registration, const std::string& from,
                                      const std::string& source);
/// Pose and covariance of such a file.
Status read_cbct_registration(const std::filesystem::path& path, CbctOptions& options);
/// Series, geometry, warnings; the patient's name and number only when asked.
nlohmann::json volume_info_json(const VolumeInfo& info, bool with_names);

}  // namespace gnathion
