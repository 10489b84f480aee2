// A CBCT volume of the phantom, rendered from its truth: teeth with enamel and dentine, alveolar bone,
// condyles, fossae, soft tissue and air, blurred by the scanner's point spread and with its noise.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "core/cbct_frame.h"
#include "core/result.h"
#include "core/transform.h"
#include "phantom/face.h"
#include "phantom/jaws.h"

namespace gnathion {

struct PhantomCbctOptions {
  std::uint64_t seed = 1;
  double voxel_mm = 0.4;
  double slice_mm = 0.0;    ///< distance of slices; 0: as the voxel
  double blur_mm = 0.2;     ///< 1σ of the point spread, isotropic
  double noise_hu = 40.0;   ///< 1σ, correlated as the blur makes it
  Motion<Dental> mandible;  ///< of the mandible from MI while the scan was taken
  bool skin = false;        ///< air around the face, and room for it in the volume
  bool joints = true;       ///< false: the field of view ends before the joints
};

/// Frame Cbct (LPS), axes along it. Voxel (i, j, k) is centred at origin + (i, j, k)·step.
struct PhantomCbct {
  std::array<int, 3> size{0, 0, 0};
  Vector3 step_mm = Vector3::Ones();
  Vector3 origin_mm = Vector3::Zero();
  std::vector<std::int16_t> hu;              ///< i fastest
  Transform<Cbct, Dental> cbct_from_dental;  ///< true
};

/// The same options give the same voxels, on any number of threads.
PhantomCbct make_phantom_cbct(const PhantomJaws& jaws, const FaceShape& face,
                              const PhantomCbctOptions& options);

/// As one .nrrd, raw.
Status write_phantom_nrrd(const std::filesystem::path& path, const PhantomCbct& cbct);

}  // namespace gnathion
