// DICOM slices of the phantom's CBCT, and of anything else a test wants a reader to see.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "phantom/cbct.h"

namespace gnathion {

/// One CT slice as a file: explicit VR, little endian.
struct DicomSliceSpec {
  std::string series_uid = "1.2.826.0.1.3680043.10.999.1", instance_uid = "1.2.826.0.1.3680043.10.999.1.1";
  std::string series_number = "1", description = "phantom", modality = "CT",
              image_type = "ORIGINAL\\PRIMARY\\AXIAL";
  std::string patient_name = "PHANTOM^ONE", patient_id = "P1";
  int instance_number = 1;
  int rows = 0, columns = 0;
  std::vector<std::int16_t> stored;  ///< rows·columns
  double slope = 1.0, intercept = 0.0;
  bool is_signed = true;
  bool placed = true;  ///< false: no position, orientation and spacing, as a photograph
  Vector3 position_mm = Vector3::Zero(), along_row = Vector3::UnitX(), along_column = Vector3::UnitY();
  double row_spacing_mm = 1.0, column_spacing_mm = 1.0, thickness_mm = 1.0;
  double tilt_deg = 0.0;  ///< 0: no tag
};
std::string format_dicom_slice(const DicomSliceSpec& spec);

/// The volume's slices, named so that their order by name is not that in space. `folder` must exist.
Status write_phantom_dicom(const std::filesystem::path& folder, const PhantomCbct& cbct);
DicomSliceSpec phantom_slice(const PhantomCbct& cbct, int k);

}  // namespace gnathion
