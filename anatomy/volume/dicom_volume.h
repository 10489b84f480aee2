// DICOM folders and files as volumes.
#pragma once

#include "anatomy/volume/read_volume.h"

namespace gnathion {

/// As read_volume() and list_volumes(), for a folder or one file of it.
Result<VolumeFile> read_dicom(const std::filesystem::path& path, const ReadVolumeOptions& options,
                              Progress& progress);
Result<std::vector<VolumeInfo>> list_dicom(const std::filesystem::path& path);

}  // namespace gnathion
