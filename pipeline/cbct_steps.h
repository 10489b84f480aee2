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
#include "registration/align.h"

namespace gnathion {

/// One arch found in a volume by its crowns.
struct CbctRegistration {
  Alignment fit;  ///< target_from_source is cbct_from_dental
  Transform<Cbct, Dental> cbct_from_dental;
  double level = 0.0;  ///< of the surface that was aligned
};

struct CbctOptions {
  ReadVolumeOptions read;
  std::optional<double> bone_level, crown_level;  ///< nothing: by Otsu
  std::optional<JointRegion> left, right;         ///< nothing: about where the arch says condyles are
  std::optional<Transform<Cbct, Dental>> cbct_from_dental;  ///< a registration made before
  std::optional<Matrix6> covariance;                        ///< its covariance
  /// Label maps instead of a threshold: labels of mandible (condyles) and skull (fossae).
  std::vector<int> condyle_labels, fossa_labels;
};

/// Registers an arch of the dental model (dental frame) to the volume. Refused (kInput) when not convincing.
Result<CbctRegistration> register_crowns(const Volume& volume, const TriangleMesh& arch,
                                         const CbctOptions& options, const std::string& name,
                                         Progress& progress);
/// The face scan over the skin surface: cbct_from_face.
Result<Alignment> register_face(const Volume& volume, const TriangleMesh& face_scan, Progress& progress);

/// The joints in the dental frame, the mandible in MI, or the plain reason why not. `path`: a folder with
/// condyle_left.stl and so on in the dental frame; or a DICOM folder, a NIfTI or NRRD file, which is
/// registered by the crowns. Where the lower teeth are in the volume, they bring the condyles to MI.
Result<Joints> joints_from_cbct(const std::filesystem::path& path, const TriangleMesh& maxilla,
                                const TriangleMesh& mandible_mi, const CbctOptions& options,
                                Progress& progress);

/// The volume itself beside its pose, for X-rays: as joints_from_cbct() reads it.
struct RegisteredVolume {
  VolumeFile file;
  Transform<Cbct, Dental> cbct_from_dental;
  std::optional<Matrix6> covariance;
};
Result<RegisteredVolume> registered_volume(const std::filesystem::path& path, const TriangleMesh& maxilla,
                                           const TriangleMesh& mandible_mi, const CbctOptions& options,
                                           Progress& progress);

/// {"kind":"pose","to":"cbct","from":"dental","unit":"mm","matrix","covariance","rms_mm","held_out_mm","condition",
/// "weak",…}: `transform = "cbct_from_dental.json"` of a [[frame]] in case.toml takes it as it is.
nlohmann::json cbct_registration_json(const CbctRegistration& registration, const std::string& source);

}  // namespace gnathion
