// Volumes from files: a DICOM series (folder or file), NIfTI (.nii, .nii.gz), NRRD (.nrrd, raw or gzip).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anatomy/volume/volume.h"
#include "core/progress.h"
#include "core/result.h"

namespace gnathion {

struct ReadVolumeOptions {
  /// Which series of a DICOM folder: its UID, its number, or its place in the list (1, 2, …) written "#2".
  /// Empty: the only one; of several, a refusal that lists them.
  std::string series;
  /// Larger volumes are refused before memory is taken for them.
  std::uint64_t largest_bytes = std::uint64_t{3} << 30;
};

/// What a file or series says of itself. The patient's name is only in `patient_name`: write it out when
/// asked.
struct VolumeInfo {
  std::string format;      ///< "DICOM", "NIfTI", "NRRD"
  std::string series_uid;  ///< DICOM: and the three below
  std::string series_number, description, modality, transfer_syntax;
  std::string patient_name, patient_id, patient_birth_date;
  std::string date;  ///< study date, YYYYMMDD; empty: unknown
  std::size_t files = 0;
  VoxelGrid grid;
  double gantry_tilt_deg = 0.0;       ///< how far the slices' normal is from the line of their positions
  std::vector<std::string> warnings;  ///< what was odd: anisotropy, filled gaps, dropped duplicates, …
};

/// A folder holds one DICOM series or several, or one NIfTI or NRRD file.
/// Refused (kInput), each by name: truncated, encrypted or undecodable files, colour pictures and secondary
/// captures without geometry, slices that are missing or contradict each other, a size that lies, spacing
/// that is not a head's in millimetres (metres and micrometres are named), more than `largest_bytes`.
struct VolumeFile {
  Volume volume;
  VolumeInfo info;
};
Result<VolumeFile> read_volume(const std::filesystem::path& path, const ReadVolumeOptions& options,
                               Progress& progress);

/// What is there, without the pixels: one entry a DICOM series, or one for another file. What cannot be used
/// as a volume is listed too, and `warnings` says why.
Result<std::vector<VolumeInfo>> list_volumes(const std::filesystem::path& path);

/// True where the path is, or holds, something that read_volume() might read; by name and first bytes alone.
bool may_hold_volume(const std::filesystem::path& path);

/// Parsers of whole files in memory, for tests and fuzzing; `name` stands in errors.
Result<VolumeFile> parse_nifti(const std::string& bytes, const std::string& name,
                               const ReadVolumeOptions& options = {});
Result<VolumeFile> parse_nrrd(const std::string& bytes, const std::string& name,
                              const ReadVolumeOptions& options = {});
/// A single DICOM file as a volume of one slice or, multi-frame, of several.
Result<VolumeFile> parse_dicom(const std::string& bytes, const std::string& name,
                               const ReadVolumeOptions& options = {});

}  // namespace gnathion
